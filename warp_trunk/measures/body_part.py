"""Measures of any part of the body: the change of the skin and its error, points, and a funnel chest."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields

import numpy as np

from warp_trunk.case import Case
from warp_trunk.case.anatomy import region
from warp_trunk.case.points import SKIN
from warp_trunk.engine.trunk_mesh import TrunkMesh, tet_volumes
from warp_trunk.geometry.distance_field import nearest
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.geometry.surface import Surface, area_vectors, corner_areas

from .comparison import same_skin
from .quantities import Measured

NEAR = 2.0
"""Studies of the face report the share of the skin that is predicted nearer than this [mm]."""


def swept_volumes(before: Surface, after: Surface) -> tuple[float, float]:
    """Volumes between two skins of the same triangles, outside the first and inside it [cm3], both positive.

    Each triangle sweeps the integral of mean displacement times area vector over its straight way; the area vector
    is quadratic in it, so that Simpson's rule is exact. Outward less inward is the change of the enclosed volume.
    """
    way = after.vertices - before.vertices
    areas = [area_vectors(before.vertices + part * way, before.faces) for part in (0.0, 0.5, 1.0)]
    mean = (areas[0] + 4.0 * areas[1] + areas[2]) / 6.0
    swept = np.einsum("fi,fi->f", way[before.faces].mean(axis=1), mean) / 1000.0
    return float(swept[swept > 0.0].sum()), float(-swept[swept < 0.0].sum())


@dataclass(frozen=True, kw_only=True, eq=False)
class Agreement:
    """Distance of a predicted skin from the actual one, by area; cut planes are left out."""

    distance_within_2_mm_percent: float
    """Share of the skin nearer than `NEAR`."""
    distance_mean_mm: float
    """Mean."""
    distance_p95_mm: float
    """The distance than which 95 % of the skin is nearer."""
    distance_maximum_mm: float
    """Largest."""
    signed: np.ndarray
    """Of each vertex [mm], positive outside the actual skin, NaN without a counterpart, shape (vertices,)."""

    def measured(self, state: str) -> list[Measured]:
        """The numbers as rows of a state."""
        return [Measured(state, "", number.name, getattr(self, number.name)) for number in fields(self)[:-1]]

    def rows(self) -> list[list[str]]:
        """The numbers as rows of a table."""
        return [
            [f"Skin nearer than {NEAR:g} mm [%]", f"{self.distance_within_2_mm_percent:.0f}"],
            ["Mean distance [mm]", f"{self.distance_mean_mm:.2f}"],
            ["95 % of the skin is nearer than [mm]", f"{self.distance_p95_mm:.2f}"],
            ["Largest distance [mm]", f"{self.distance_maximum_mm:.2f}"],
        ]


def agreement(predicted: Surface, actual: Surface) -> Agreement:
    """How a predicted skin agrees with the actual one."""
    signed, counted = same_skin(predicted, actual)
    size, area = np.abs(signed)[counted], corner_areas(predicted)[counted]
    return Agreement(
        distance_within_2_mm_percent=100.0 * float(area[size <= NEAR].sum() / area.sum()),
        distance_mean_mm=float(np.average(size, weights=area)),
        distance_p95_mm=float(np.quantile(size, 0.95, weights=area, method="inverted_cdf")),
        distance_maximum_mm=float(size.max()),
        signed=np.where(counted, signed, np.nan),
    )


def tissue_volume_change(trunk: TrunkMesh, displacement: np.ndarray) -> float:
    """How much the soft tissue as a whole has grown [%], negative where it shrank.

    Soft tissue is nearly incompressible, so a simulation that changes its volume by percents is not to be
    trusted there. An inverted tetrahedron counts as negative.

    Args:
        trunk: the mesh between bones and skin.
        displacement: of its nodes [mm], shape (nodes, 3).
    """
    before = tet_volumes(trunk.nodes, trunk.tets).sum()
    after = tet_volumes(trunk.nodes + displacement, trunk.tets).sum()
    return 100.0 * (float(after / before) - 1.0)


Place = tuple[float, float, float]


@dataclass(frozen=True)
class FollowedPoint:
    """A point before surgery and as predicted, in LPS."""

    name: str
    """Its name."""
    on: str
    """On what it lies, `skin` or a bone."""
    before: Place
    """Before surgery [mm]."""
    after: Place
    """As predicted [mm]."""
    bone_point: str = ""
    """The point on bone with which it is compared; empty for none."""
    ratio: float | None = None
    """How far it moves along the way of that point, as a part of that way: s.h / h.h; None for no way."""

    @property
    def way(self) -> np.ndarray:
        """From before to after [mm], shape (3,)."""
        return np.subtract(self.after, self.before)

    @property
    def distance(self) -> float:
        """How far it moves [mm]."""
        return float(np.linalg.norm(self.way))


def follow_points(
    case: Case, skin: np.ndarray, motion_of: Callable[[str], RigidMotion]
) -> tuple[FollowedPoint, ...]:
    """Displaced points of a case: on the skin with their triangle, on bone rigidly.

    Args:
        case: the case with its points.
        skin: vertices of the predicted skin [mm], shape (vertices, 3).
        motion_of: the motion of a bone by its name.
    """
    marks = case.points.marks
    moved: dict[str, tuple[str, np.ndarray, np.ndarray]] = {}
    for name, point, (owner, _) in zip(marks.names, marks.points, case.point_owners, strict=True):
        if owner == SKIN:
            face, weights = nearest(case.skin, point[None], 1000.0)
            corners = case.skin.faces[face[0]]
            way = weights[0] @ (skin[corners] - case.skin.vertices[corners])
        else:
            way = motion_of(owner).apply(point) - point
        moved[name] = owner, point, way
    followed = []
    for name, (owner, point, way) in moved.items():
        other = case.points.pairs.get(name, "")
        hard = moved[other][2] if other else np.zeros(3)
        ratio = float(way @ hard / (hard @ hard)) if np.linalg.norm(hard) > 1e-3 else None
        followed.append(FollowedPoint(name, owner, _place(point), _place(point + way), other, ratio))
    return tuple(followed)


def _place(point: np.ndarray) -> Place:
    x, y, z = point.tolist()
    return x, y, z


ANGLES = {
    "Nasolabial angle [°]": ("columella", "subnasale", "upper_lip"),
    "Mentolabial angle [°]": ("lower_lip", "mentolabial_fold", "chin"),
}
"""Each with its first point, its corner and its last point (Legan and Burstone 1980)."""
LINE = ("nose_tip", "chin")
"""The ends of the E-line (Ricketts 1957)."""


def profile(places: Mapping[str, np.ndarray]) -> dict[str, float]:
    """The measures whose points are there: angles, and how far lips are in front of the E-line, from the side.

    Args:
        places: points by name, in LPS [mm], shape (3,) each.
    """
    sizes = {}
    for name, corners in ANGLES.items():
        if places.keys() >= set(corners):
            first, corner, last = (places[point] for point in corners)
            a, b = first - corner, last - corner
            sizes[name] = math.degrees(math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b)))
    if places.keys() >= set(LINE):
        tip, chin = (places[name] for name in LINE)
        _, back, up = chin - tip
        for lip in {"upper_lip", "lower_lip"} & places.keys():
            _, behind, above = places[lip] - tip
            sizes[f"{lip} in front of the E-line [mm]"] = float(behind * up - above * back) / math.hypot(back, up)
    return dict(sorted(sizes.items()))


_HEIGHT_STEP = 5.0
"""Distances between sternum and vertebra are measured at heights this far apart [mm]."""
_COLUMN = 15.0
"""Width of the columns in which the inside of the wall is found [mm]; narrower ones miss it between vertices."""
_MIDLINE = 10.0
"""The sternum is measured within this distance of its middle [mm]."""
_SLAB = 12.0
"""Ribs cross a plane obliquely: those within this height of it count [mm]."""


_WALL = ("rib_", "costal_")


def is_of_chest(bone: str) -> bool:
    """Whether an index depends on a bone."""
    return bone == "sternum" or region(bone) == "T" or bone.startswith(_WALL)


@dataclass(frozen=True, kw_only=True)
class ChestIndices:
    """The indices of a chest at the height where the lower half of the sternum is nearest to the spine."""

    haller: float
    """Haller index: the largest inner width of the chest over the smallest distance between sternum and vertebra
    (Haller, Kramer and Lietman, J. Pediatr. Surg. 22, 1987, 904-906)."""
    correction_percent: float
    """Correction index: 100 (b - a) / b with that smallest distance a and the largest distance b from the front of
    the vertebra to the inside of the front wall (St. Peter et al., J. Pediatr. Surg. 46, 2011, 2270-2273)."""
    sternal_angle_deg: float
    """External sternal angle: the inclination to the vertical of the skin over the midline of the sternum, by a
    straight line fitted to it [degrees]; positive where its lower end lies further forward."""


CHEST_LABELS = {
    "haller": "Haller index",
    "correction_percent": "Correction index [%]",
    "sternal_angle_deg": "External sternal angle [°]",
}
"""The indices as pages name them."""


def chest_indices(skin: Surface, bones: Mapping[str, Surface]) -> ChestIndices | None:
    """The indices of a chest; None without a sternum, both sides of ribs and a vertebra at that height.

    Args:
        skin: the skin in LPS [mm].
        bones: bones by name, in the same state.
    """
    thoracic = [bones[name].vertices for name in bones if region(name) == "T"]
    wall = [bones[name].vertices for name in bones if name.startswith(_WALL)]
    if "sternum" not in bones or not thoracic or not wall:
        return None
    sternum, spine, ribs = bones["sternum"].vertices, np.vstack(thoracic), np.vstack(wall)
    middle = float(np.median(sternum[:, 0]))
    body = spine[np.abs(spine[:, 0] - middle) < _MIDLINE]
    central = sternum[np.abs(sternum[:, 0] - middle) < _MIDLINE]
    depths = {}
    low, high = sternum[:, 2].min(), sternum[:, 2].max()
    for height in np.arange(low + _HEIGHT_STEP, 0.5 * (low + high), _HEIGHT_STEP):
        front, back = (_slab(points, height, _HEIGHT_STEP)[:, 1] for points in (body, central))
        if len(front) and len(back):
            depths[height] = float(front.min() - back.max()), float(front.min())
    if not depths:
        return None
    height = min(depths, key=lambda at: depths[at][0])
    nearest, vertebra = depths[height]
    around = _slab(np.vstack([ribs, sternum]), height, _SLAB)
    lateral = around[around[:, 1] < vertebra + 2.0 * nearest]
    widths = [
        float(lateral[row & right, 0].min() - lateral[row & ~right, 0].max())
        for row in _columns(lateral[:, 1])
        if (right := lateral[:, 0] > middle)[row].any() and (~right)[row].any()
    ]
    ahead = around[around[:, 1] < vertebra - 0.5 * nearest]
    inner = [float(ahead[column, 1].max()) for column in _columns(ahead[:, 0])]
    line = skin.vertices[np.abs(skin.vertices[:, 0] - middle) < _MIDLINE]
    line = line[(line[:, 1] < vertebra) & (line[:, 2] > low) & (line[:, 2] < high)]
    if not widths or not inner or len(line) < 3:
        return None
    furthest = max(vertebra - min(inner), nearest)
    return ChestIndices(
        haller=max(widths) / nearest,
        correction_percent=100.0 * (furthest - nearest) / furthest,
        sternal_angle_deg=math.degrees(math.atan(float(np.polyfit(line[:, 2], line[:, 1], 1)[0]))),
    )


def _slab(points: np.ndarray, height: float, half: float) -> np.ndarray:
    return points[np.abs(points[:, 2] - height) < half]


def _columns(values: np.ndarray) -> list[np.ndarray]:
    """Which values (n,) lie in each column of width `_COLUMN`, shape (n,) bool each."""
    number = np.floor(values / _COLUMN)
    return [number == column for column in np.unique(number)]
