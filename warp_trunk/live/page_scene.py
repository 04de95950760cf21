"""The scene: skin, bones, lines of depth, and from where they are seen."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import viser
from scipy.spatial.transform import Rotation

from warp_trunk.case import Case
from warp_trunk.case.anatomy import rank
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.geometry.section import crossed
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files.morph import skin_glb
from warp_trunk.report.style import BEFORE, PLANS
from warp_trunk.views.clothing import COLOURS, Garment

from .session import PlanView
from .sliders import MotionPlan

SKIN, BONE, FUSED, INK = (226, 190, 168), (236, 228, 206), (0, 114, 178), (70, 58, 52)
"""Colours; blue is what is planned, as in the report."""
UPRIGHT = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)
"""The turn of glTF, whose y goes up, into the axes of the patient."""
SEEN_THROUGH = 0.5
"""Opacity of a skin that is seen through."""
SIDES = {"Behind": (0.0, 1.0), "Left side": (1.0, 0.0), "Front": (0.0, -1.0), "Right side": (-1.0, 0.0)}
"""Directions from which the patient is seen, x and y."""
MARGIN = 35.0
"""Of the names of the sides and the bar beside the trunk [mm]."""
_DISTANCE = 1.75
"""How far away the eye is, in heights of the trunk."""
BAR = 100.0
"""Length of the bar that shows the scale [mm]."""
_FIELD = 38.0
"""Field of view [degrees]."""


class PageScene:
    """The patient in the browser. Vertices and poses change, nothing else is sent again."""

    def __init__(self, server: viser.ViserServer, case: Case) -> None:
        self._server, self._case = server, case
        self.painted: viser.GlbHandle | None = None
        """The skin in its own colours, in place of the plain one."""
        self._is_before, self._settled = False, False
        self._surgery, self._view, self._planned, self._own = None, None, set[str](), False
        scene, skin = server.scene, replace(case.skin, faces=outer_first(case.skin))
        scene.set_up_direction("+z")
        scene.configure_default_lights(cast_shadow=False)
        self.skin = scene.add_mesh_simple("/skin", skin.vertices, skin.faces, color=SKIN, opacity=SEEN_THROUGH)
        self.before = scene.add_mesh_simple(
            "/before", skin.vertices, skin.faces, color=_rgb(BEFORE.colour), opacity=SEEN_THROUGH, visible=False
        )
        self.compared = scene.add_line_segments(
            "/kept",
            np.zeros((1, 2, 3)),
            _rgb(PLANS[1].colour),
            thickness=2.0,
            thickness_units="screen",
            visible=False,
        )
        self.garment = Garment(case.skin, case.landmarks_before) if case.has_spine else None
        """The clothes of the patient."""
        self._clothes: dict[str, viser.MeshHandle] = {}
        if self.garment is not None:
            for name, places in self.garment.on(case.skin.vertices).items():
                faces, colour = self.garment.faces[name], COLOURS[name]
                self._clothes[name] = scene.add_mesh_simple(f"/{name}", places, faces, color=colour, side="double")
        self.relief = scene.add_line_segments(
            "/relief", relief_lines(skin.vertices, skin.faces), INK, thickness=1.2, thickness_units="screen"
        )
        self.relief.visible = case.has_spine  # lines of the back
        self._unseen = (
            None if case.unseen is None else case.skin.faces[(case.unseen > 0.5)[case.skin.faces].all(axis=1)]
        )
        self._hatch = scene.add_line_segments(
            "/invented",
            self._hatched(),
            INK,
            thickness=1.5,
            thickness_units="screen",
            visible=case.unseen is not None,
        )
        self._names = {
            level: scene.add_label(f"/names/{level}", level, font_screen_scale=0.8, anchor="center-center")
            for level in (case.landmarks_before.vertebrae() if case.has_spine else ())
        }
        self._bones = {
            name: scene.add_mesh_simple(f"/bones/{name}", bone.vertices, bone.faces, color=BONE)
            for name, bone in case.bones.items()
        }
        low, high = skin.vertices.min(axis=0), skin.vertices.max(axis=0)
        self._add_marks(scene, low, high)
        self._middle, self._height = (low + high) / 2.0, float(high[2] - low[2])
        self._wide = float(high[0] - low[0]) + 2.0 * MARGIN
        camera = server.initial_camera
        camera.near, camera.far, camera.fov = 10.0, 20.0 * self._height, np.radians(_FIELD)
        camera.position, camera.look_at = self.eye("Behind" if case.has_spine else "Front"), self._middle

    def _add_marks(self, scene: viser.SceneApi, low: np.ndarray, high: np.ndarray) -> None:
        """Names of the sides, and an upright bar of `BAR` at the right."""
        deep, beside = (low[1] + high[1]) / 2.0, low[2] + 0.3 * (high[2] - low[2])
        for text, x in (("left", high[0] + MARGIN), ("right", low[0] - MARGIN)):
            scene.add_label(f"/sides/{text}", text, position=(x, deep, beside), anchor="center-center")
        x, bottom = low[0] - MARGIN, low[2]
        ends = np.array([[[x, deep, bottom], [x, deep, bottom + BAR]]], np.float32)
        scene.add_line_segments("/bar", ends, INK, thickness=3.0, thickness_units="screen")
        scene.add_label("/bar/length", f"{BAR:g} mm", position=(x, deep, bottom + BAR), anchor="bottom-center")

    def show(self, view: PlanView) -> None:
        """Draws the skin and the bones of a view; browsers get all of it at once."""
        with self._server.atomic():
            self.skin.vertices = view.skin.astype(np.float32)
            self._settled = view.settled
            self._lines()
            self._paint()
            self._dress()
            if view.surgery is not self._surgery:
                self._surgery, self._view = view.surgery, view
                self._move_bones()

    def _move_bones(self) -> None:
        """Places the bones of what is shown: of the plan, or before surgery, where none is planned."""
        view, still = self._view, RigidMotion.identity()
        if view is None:
            return
        motions = dict.fromkeys(self._bones, still) if self._is_before else view.motions
        turns = Rotation.from_matrix([motions[name].rotation for name in self._bones])
        for (name, bone), turn in zip(self._bones.items(), turns.as_quat(scalar_first=True), strict=True):
            bone.wxyz, bone.position = turn, motions[name].translation
        planned = set[str]() if self._is_before else _planned_bones(view)
        for bone in self._bones.keys() & (planned ^ self._planned):
            self._bones[bone].color = FUSED if bone in planned else BONE
        self._planned = planned
        spine = self._case.landmarks_before
        if not self._is_before and not isinstance(view.surgery, MotionPlan):
            spine = view.surgery.landmarks_after
        for level, label in self._names.items():
            label.position = spine.of_bone(level).points.mean(axis=0)

    def show_before(self, shown: bool) -> None:
        """Shows the trunk before surgery in place of the plan."""
        self._is_before = shown
        self._lines()
        self._move_bones()
        self._paint()
        self._dress()

    def show_own(self, shown: bool) -> None:
        """Shows the colours of the scan, or one for the whole skin."""
        self._own = shown
        self._paint()

    def show_clothes(self, shown: bool) -> None:
        """Puts on shorts and a shirt that is open behind, or takes them off."""
        for cloth in self._clothes.values():
            cloth.visible = shown
        self._dress()

    def show_names(self, shown: bool) -> None:
        """Writes the name of each vertebra on it, or none."""
        for label in self._names.values():
            label.visible = shown

    def show_relief(self, shown: bool) -> None:
        """Draws lines of equal depth on the back, or none."""
        self.relief.visible = shown
        self._lines()

    def show_through(self, shown: bool) -> None:
        """Makes the skins transparent."""
        for skin in (self.skin, self.before):
            skin.opacity = SEEN_THROUGH if shown else None

    def compare(self, vertices: np.ndarray | None) -> None:
        """Draws the outlines of another skin (vertices, 3) [mm] at every `OUTLINE` of height; none for None."""
        self.compared.visible = vertices is not None
        if vertices is not None:
            self.compared.points = outlines(vertices.astype(np.float32), self._case.skin.faces)

    def eye(self, side: str) -> np.ndarray:
        """Where the eye is to see the patient from one of `SIDES` [mm]."""
        x, y = SIDES[side]
        return self._middle + _DISTANCE * self._height * np.array([x, y, 0.08])

    def look(self, camera: viser.CameraHandle, side: str) -> None:
        """Turns one browser's eye to a side, from as far as its window needs."""
        with camera.client.atomic():
            away = max(1.0, self._wide / (self._height * max(camera.aspect, 0.1)))
            camera.position = self._middle + away * (self.eye(side) - self._middle)
            camera.look_at = self._middle
            camera.up_direction = (0.0, 0.0, 1.0)

    def stand_back(self, camera: viser.CameraHandle) -> None:
        """Turns the eye of a browser that has just opened the page to where it begins."""
        self.look(camera, "Behind" if self._case.has_spine else "Front")

    def _paint(self) -> None:
        """Draws the skin, in its own colours once it no longer moves, as these are sent again each time."""
        shown = self.before if self._is_before else self.skin
        painted = self._own and (self._is_before or self._settled)
        if painted:
            glb = skin_glb(self._case.skin.moved(np.asarray(shown.vertices)), None, ("skin", ""))
            self.painted = self._server.scene.add_glb("/painted", glb, scale=1000.0, wxyz=UPRIGHT)
        elif self.painted is not None:
            self.painted.visible = False
        for skin in (self.before, self.skin):
            skin.visible = skin is shown and not painted

    def _dress(self) -> None:
        """Moves the clothes to the skin that is shown."""
        if self.garment is not None:
            shown = self.before if self._is_before else self.skin
            for name, places in self.garment.on(np.asarray(shown.vertices)).items():
                self._clothes[name].vertices = places.astype(np.float32)
        if self._unseen is not None:
            self._hatch.points = self._hatched()

    def _hatched(self) -> np.ndarray:
        """The hatch of what was not measured: of the skin, and of the shirt over it."""
        if self._unseen is None:
            return np.zeros((1, 2, 3), np.float32)
        shown = np.asarray((self.before if self._is_before else self.skin).vertices)
        lines = [hatch_lines(shown, self._unseen)]
        if (shirt := self._clothes.get("shirt")) is not None and shirt.visible:
            lines.append(hatch_lines(np.asarray(shirt.vertices), np.asarray(shirt.faces)))
        return np.concatenate(lines)

    def _lines(self) -> None:
        """Draws the lines of what is shown, where lines are."""
        if self.relief.visible:
            shown = self.before if self._is_before else self.skin
            self.relief.points = relief_lines(shown.vertices, self._case.skin.faces)


def _planned_bones(view: PlanView) -> set[str]:
    """The bones that a plan moves on purpose: those of the fusion, or those of its motions."""
    if isinstance(view.surgery, MotionPlan):
        return set(view.surgery.motions)
    upper, lower = rank(view.surgery.plan.uiv), rank(view.surgery.plan.liv)
    return {level for level in view.surgery.landmarks_after.vertebrae() if upper <= rank(level) <= lower}


def _rgb(colour: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


LINE_DISTANCE = 5.0
"""From one line to the next [mm]."""
_FACING = 0.5
"""Where the skin faces back by less than this (a cosine: 60 degrees), it is flank and lines would run together."""
_LIFT = 0.6
"""Distance of lines in front of the skin, so that they are visible [mm]."""


HATCH = 14.0
"""From one line of a hatch to the next, along x and z [mm]."""
OUTLINE = 15.0
"""From one outline of a compared skin to the next [mm]."""


def outlines(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Horizontal sections of a skin, `OUTLINE` apart, as `level_lines` returns them."""
    return level_lines(vertices, faces, vertices[:, 2], OUTLINE)


def hatch_lines(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Slanting lines `HATCH` apart on some triangles, as `level_lines` returns them."""
    ends = level_lines(vertices, faces, vertices[:, 0] + vertices[:, 2], HATCH)
    out = ends[:, :, :2] - vertices[:, :2].mean(axis=0)
    ends[:, :, :2] += _LIFT * out / np.maximum(np.linalg.norm(out, axis=2, keepdims=True), 1e-6)
    return ends


def outer_first(skin: Surface) -> np.ndarray:
    """The triangles from the outermost, about the vertical axis of the skin, to the innermost, shape (faces, 3).

    A browser does not sort triangles that are seen through: of two that face the eye, the nearer one, which is
    mostly farther out, must be drawn first to hide the other.
    """
    centres = skin.vertices[skin.faces].mean(axis=1)[:, :2] - skin.vertices.mean(axis=0)[:2]
    return skin.faces[np.argsort(-np.linalg.norm(centres, axis=1), kind="stable")]


def relief_lines(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Where planes of equal depth (y), `LINE_DISTANCE` apart, cut the part of a skin that faces back, as
    `level_lines` returns it."""
    ends = level_lines(vertices, faces, vertices[:, 1], LINE_DISTANCE, _face_back)
    ends[:, :, 1] += _LIFT
    return ends


def level_lines(
    vertices: np.ndarray,
    faces: np.ndarray,
    values: np.ndarray,
    distance: float,
    drawn: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Lines along which values at vertices are the same, from one to the next by a distance in them.

    Args:
        vertices: of the skin [mm], shape (vertices, 3); float32 is enough, and faster.
        faces: its triangles, shape (faces, 3).
        values: at its vertices, shape (vertices,).
        distance: from line to line.
        drawn: which triangles, by corner (3, triangles), of the vertices have lines; all when left out.

    Returns:
        Ends of line segments [mm], shape (segments, 2, 3), of the type of the vertices.
    """
    scaled, corners = values / values.dtype.type(distance), np.ascontiguousarray(faces.T)  # steps go along rows
    cut, level = crossed(np.floor(scaled).astype(np.int32), corners)
    if drawn is not None:
        shown = drawn(vertices, corners[:, cut])
        cut, level = cut[shown], level[shown]
    return _segments(vertices, scaled, corners[:, cut], (level + 1).astype(scaled.dtype))


def _face_back(vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Whether triangles, by corner (3, triangles), face back."""
    (ax, bx, cx), (ay, by, cy), (az, bz, cz) = (along.take(corners) for along in vertices.T)
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return y > _FACING * np.sqrt(x * x + y * y + z * z)


def _segments(vertices: np.ndarray, depth: np.ndarray, corners: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Where each triangle (3, segments) is cut by one plane, in steps of depth, that has corners on both sides."""
    first, second, third = depth.take(corners) >= level
    alone = np.where(first == second, 2, np.where(first == third, 1, 0))  # the corner on a side of its own
    start, left, right = np.take_along_axis(corners, (alone + np.arange(3)[:, None]) % 3, axis=0)
    origin, start_depth = vertices.take(start, axis=0), depth.take(start)
    ends = np.empty((len(level), 2, 3), vertices.dtype)
    for side, end in enumerate((left, right)):
        share = (level - start_depth) / (depth.take(end) - start_depth)
        ends[:, side] = origin + share[:, None] * (vertices.take(end, axis=0) - origin)
    return ends
