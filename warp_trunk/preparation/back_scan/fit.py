"""A case from a scan of the back, a spine and markers: a body is fitted to all three."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from warp_trunk.case import Case
from warp_trunk.case.anatomy import PELVIC_RING, VERTEBRAE
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.uncertainty import Invented
from warp_trunk.checking import Array, checked
from warp_trunk.errors import InputError
from warp_trunk.geometry.colours import coloured_from_points
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.surface import Surface, corner_areas
from warp_trunk.geometry.surface_checks import crossings
from warp_trunk.measures.markers import back_markers

from ..deformity.deformity import carried, grown
from ..deformity.patient_spine import PatientSpine
from ..deformity.spine_curve import VertebraPose
from .body import StraightBody, made_body
from .bones import all_under_skin, forward_under_skin, ribs_on_vertebrae
from .frame import PelvisFrame, check_on_scan, find_frame
from .scan import BackScan, check_inside, clean_scan
from .spine import TURN_SD, PlacedSpine, place_spine, placed_poses, turns_of
from .warping import ScanField, draw_to_scan, on_trunk, seen_by, warp_onto

_GROWS = 18.0
"""Points of the scan that the smooth warps missed are followed to this distance from the warped body [mm]."""
_CLEAR = 15.0
"""Where the skin would cross itself, points of the scan nearer than this are left out [mm]."""
_TRIES = 4
_PLACINGS = 3
"""How often the vertebrae are placed: the height of the landmarks of one depends on its pose."""


@dataclass(frozen=True, eq=False)
class FittedBack:
    """A case fitted to a scan of the back, and how well it fits."""

    case: Case
    """In the frame of the scan, without a plan."""
    seen: np.ndarray
    """Which vertices of its skin lie on the scan, bool, shape (vertices,)."""
    scan: BackScan
    """The points of the trunk, in the frame of the scan."""
    left_out: np.ndarray
    """Points beyond the trunk: surroundings, arms, hair, clothes, stray points [mm], shape (m, 3)."""
    distance: np.ndarray
    """From each point of the scan to the skin [mm], shape (n,)."""
    body: str
    """The name of the body that was fitted."""
    scale: float
    """Its size over what it was."""
    forward: np.ndarray
    """How far T1 to L5 were moved forward to lie under the skin [mm], shape (17,)."""
    moved: np.ndarray
    """How far the pelvis went to the left, back and up from where the markers put it, to lie under L5 [mm]."""

    @property
    def invented(self) -> float:
        """Share of the area of the skin that the scan does not show."""
        return 0.0 if self.case.invented is None else self.case.invented.share


@checked
def fit_back(
    points: Annotated[np.ndarray, Array(None, 3, finite=False)],
    spine: PatientSpine,
    markers: Landmarks,
    body: StraightBody | None = None,
    name: str = "back",
    *,
    colours: Annotated[np.ndarray, Array(None, 3, kind=np.uint8)] | None = None,
    files: tuple[str, str, str] = ("back", "spine", "markers"),
) -> FittedBack:
    """Fit a straight body to a scan of the back, the spine under it and markers of the pelvis.

    The body takes the size of the patient and the spine's curve, with ribs that follow; its pelvis is held square
    to the iliac spines. Three smooth warps bring skin and ribs onto the scan, the vertebrae at rest; then the
    skin is drawn to the points themselves where there are some (`draw_to_scan`).

    >>> from warp_trunk.preparation.back_scan.scan import cut_back
    >>> points, spine, markers = cut_back(case)
    >>> wt.fit_back(points, spine, markers).case.invented.source
    'a scan of the back'

    Args:
        points: of the scan in mm and LPS, shape (n, 3).
        spine: `spine_line`, `spine_of_marks` or `read_patient_spine`, in the frame of the scan.
        markers: C7 and both PSIS or ASIS on the skin.
        body: what is fitted; one that the program makes when left out.
        name: of the case.
        colours: of the points, shape (n, 3), uint8; what the scan does not show takes their median.
        files: what to call scan, spine and markers in an error.

    Raises:
        InputError: a scan, spine or markers that are none of a back, or not in one frame.
    """
    back, line, marks = files
    held = back_markers(markers, what=marks)
    scan = clean_scan(points, spine.line, back, line)
    check_on_scan(markers, scan.points, marks)
    check_inside(scan.points, spine.line, back, line)
    body = body or made_body()
    rise: np.ndarray | float = 0.0
    placings = 0
    while True:
        asked = place_spine(spine, held, body.centres, rise)
        frame = find_frame(body, held, asked)
        placed = asked.turned(frame.rotation.T, frame.shift)
        straight = body.scaled(frame.scale).fitted_to(placed.centres)
        turns = turns_of(placed, spine.kind == "pedicles")
        placings += 1
        if placings == _PLACINGS:
            break
        poses = placed_poses(placed, turns, straight.centres, straight.axes)
        marks = {level: straight.landmarks.of_bone(level).points for level in VERTEBRAE}
        centroids = np.array([poses[level](marks[level]).mean(axis=0) for level in VERTEBRAE])
        rise = frame.to_patient(centroids)[:, 2] - asked.centres[:, 2]
    scan = scan.carried(frame.to_body, frame.rotation.T)
    skin, bones, landmarks, used, forward = _fitted(straight, placed, turns, scan, back, line)
    everything = np.vstack([frame.to_patient(p) for p in (scan.points[~used], scan.stray)])
    used_scan = scan.chosen(used)
    distance = np.abs(SurfaceDistance(skin).at(used_scan.points))
    seen = seen_by(skin, used_scan)
    used_scan = used_scan.carried(frame.to_patient, frame.rotation)
    area, unseen, of_patient = corner_areas(skin), ~seen, _turned(skin, frame)
    if colours is not None:
        of_patient = coloured_from_points(of_patient, points, colours, _GROWS)
    case = Case(
        invented=Invented(
            body=body.name,
            share=round(float(area[unseen].sum() / area.sum()), 3),
            vertebral_turn=TURN_SD[spine.kind],
        ),
        unseen=unseen,
        name=name,
        skin=of_patient,
        bones={bone: _turned(surface, frame) for bone, surface in bones.items()},
        landmarks_before=Landmarks(landmarks.names, frame.to_patient(landmarks.points)),
    )
    return FittedBack(case, seen, used_scan, everything, distance, body.name, frame.scale, forward, frame.moved)


def _fitted(
    straight: StraightBody, placed: PlacedSpine, turns: np.ndarray, scan: BackScan, back: str, where: str
) -> tuple[Surface, dict[str, Surface], Landmarks, np.ndarray, np.ndarray]:
    """Skin, bones, landmarks, which points of the scan were used, and how far the vertebrae went forward."""
    pelvis = [straight.bones[bone].vertices[::12] for bone in PELVIC_RING if bone in straight.bones]

    def fitted(forward: np.ndarray) -> tuple[Surface, dict[str, Surface], Landmarks, dict[str, VertebraPose]]:
        now = replace(placed, centres=placed.centres - forward[:, None] * [0.0, 1.0, 0.0])
        poses = placed_poses(now, turns, straight.centres, straight.axes)
        landmarks, growth = grown(straight.skin, straight.bones, straight.landmarks, poses, 0.0)
        skin = Surface(growth(straight.skin.vertices), straight.skin.faces)
        ends = landmarks.points[["endplate" in name for name in landmarks.names]]
        warp = warp_onto(skin, ScanField(scan), np.vstack([ends, *pelvis]))
        bones = carried(straight.bones, poses, lambda points: warp(growth(points)))
        return Surface(warp(skin.vertices), skin.faces), bones, landmarks, poses

    forward = np.zeros(len(VERTEBRAE))
    warped, bones, landmarks, poses = fitted(forward)
    for _ in range(2):  # vertebrae that must go forward take their ribs along
        more = forward_under_skin(bones, warped, where)
        if not more.any():
            break
        forward = forward + more
        warped, bones, landmarks, poses = fitted(forward)
    drawn, used = _drawn(warped, scan, back)
    bones = ribs_on_vertebrae(bones, straight.bones, poses)
    bones = all_under_skin(bones, drawn, VERTEBRAE)
    return drawn, bones, landmarks, used, forward


def _drawn(warped: Surface, scan: BackScan, where: str) -> tuple[Surface, np.ndarray]:
    """The skin drawn to the scan without crossing itself, and the points that were used, bool."""
    from scipy.spatial import KDTree  # heavy

    first = on_trunk(warped, scan)
    skin = draw_to_scan(warped, scan.chosen(first))
    near = np.abs(SurfaceDistance(warped).at(scan.points)) < _GROWS
    allowed = np.ones(len(near), dtype=bool)
    for _ in range(_TRIES):
        used = on_trunk(skin, scan) & near & allowed
        skin = draw_to_scan(warped, scan.chosen(used))
        crossed = crossings(skin)
        if not len(crossed):
            return skin, used
        middles = skin.vertices[skin.faces[np.unique(crossed)]].mean(axis=1)
        allowed &= np.asarray(KDTree(middles).query(scan.points)[0]) > _CLEAR
        skin = warped
    cure = "give a scan without loose pieces"
    raise InputError(f"{where}: the skin crosses itself where it follows the scan; {cure}")


def _turned(surface: Surface, frame: PelvisFrame) -> Surface:
    return Surface(frame.to_patient(surface.vertices), surface.faces)
