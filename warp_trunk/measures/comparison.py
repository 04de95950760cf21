"""One skin of a patient against another: distances by region, and how well a prediction agrees."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from warp_trunk.case.anatomy import LUMBAR, THORACIC, VERTEBRAE
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.checking import checked
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface, check_surface, corner_areas, unit, vertex_normals
from warp_trunk.spine.spine import asis_axis, spine_of

from .back_rotation import back_surface_rotation
from .quantities import DETECTABLE, Measured

_SAME_WAY = 0.5
"""Cosine of 60 degrees: skin whose nearest point lies, or faces, further aside than this has none."""
_TOUCHING = 1.0
"""Where the nearest point is nearer than this its direction says nothing [mm]."""


Rotations = Mapping[str, float | None]
"""Back surface rotation by level [degrees]; None where it is missing."""


@dataclass(frozen=True)
class DistanceStatistics:
    """Distances of one region of a skin from another skin [mm], each vertex weighted by its area."""

    area: float
    """How much of the first skin counts [cm2]."""
    signed_mean: float
    """Mean with its sign, positive where the first skin lies outside the second."""
    mean: float
    """Mean of the sizes."""
    rms: float
    """Root mean square."""
    p95: float
    """Of the area, 95 % is nearer than this."""
    maximum: float
    """Largest size."""
    symmetric_mean: float
    """Mean of the sizes over both skins, each measured from the other."""
    symmetric_maximum: float
    """Largest size over both: the Hausdorff distance of what counts."""


@dataclass(frozen=True, eq=False)
class SkinDistance:
    """Distances of the vertices of one skin from another."""

    signed: np.ndarray
    """Distance [mm] of each vertex, positive outside the other skin, shape (n,)."""
    counted: np.ndarray
    """True where the vertex lies in a region and its nearest point is the same skin, shape (n,)."""
    regions: Regions
    """Where the vertices lie."""


def skin_distance(skin: Surface, other: Surface, landmarks: Landmarks) -> SkinDistance:
    """Signed distance from each vertex of a skin to the nearest point of another skin, whatever its triangles.

    Cut planes are not skin and must not count. Those through neck and thighs face up and down, which no region
    does; the arms' lie in the flanks, so that back and front are free of them. Where one skin is cut off before
    the other, what the other has more is left out: there the nearest point is on the edge of the cut, not
    straight in front of or behind the skin (by more than 60 degrees), or faces another way (the rules of
    registration, Rusinkiewicz and Levoy 2001).

    Args:
        skin: whose vertices are measured [mm].
        other: closed [mm], in the same frame.
        landmarks: those that go with both [mm].

    Raises:
        InputError: no ASIS, or no vertebra, among the landmarks.
    """
    regions = regions_of(skin, landmarks)
    signed, counted = same_skin(skin, other)
    in_region = np.logical_or.reduce(list(regions.masks.values()))
    return SkinDistance(signed, counted & in_region, regions)


def same_skin(skin: Surface, other: Surface) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance of each vertex of a skin from another one [mm], and whether its nearest point there is the
    same skin, see `skin_distance`; shape (vertices,) each."""
    from warp_trunk.geometry.distance_field import SurfaceDistance  # heavy

    normals = vertex_normals(skin)
    nearest = SurfaceDistance(other).nearest(skin.vertices)
    straight = np.abs(np.vecdot(unit(nearest.point - skin.vertices), normals)) > _SAME_WAY
    facing = vertex_normals(other)[other.faces[nearest.face]].mean(axis=1)  # a triangle of a scan is mostly noise
    counted = (straight | (np.abs(nearest.distance) < _TOUCHING)) & (np.vecdot(unit(facing), normals) > _SAME_WAY)
    return nearest.distance.astype(np.float64), counted


def distance_statistics(to_other: SkinDistance, back: SkinDistance) -> dict[str, DistanceStatistics | None]:
    """Statistics by region, from the distances of one skin to the other and back again; None for empty regions."""
    statistics: dict[str, DistanceStatistics | None] = {}
    for region, mask in to_other.regions.masks.items():
        first = _counted(to_other, mask)
        second = _counted(back, back.regions.masks[region])
        statistics[region] = _statistics(*first, *second) if len(first[0]) and len(second[0]) else None
    return statistics


def _counted(distance: SkinDistance, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    mask = mask & distance.counted & (distance.regions.area > 0.0)
    return distance.signed[mask], distance.regions.area[mask]


def _statistics(
    signed: np.ndarray, area: np.ndarray, other_signed: np.ndarray, other_area: np.ndarray
) -> DistanceStatistics:
    size, other_size = np.abs(signed), np.abs(other_signed)
    both = np.average(np.append(size, other_size), weights=np.append(area, other_area))
    return DistanceStatistics(
        area=float(area.sum()) / 100.0,
        signed_mean=float(np.average(signed, weights=area)),
        mean=float(np.average(size, weights=area)),
        rms=float(np.sqrt(np.average(size**2, weights=area))),
        p95=float(np.quantile(size, 0.95, weights=area, method="inverted_cdf")),
        maximum=float(size.max()),
        symmetric_mean=float(both),
        symmetric_maximum=float(max(size.max(), other_size.max())),
    )


BANDS = {
    "upper thoracic": THORACIC[:4],
    "main thoracic": THORACIC[4:],
    "lumbar": LUMBAR,
}
"""Vertebral levels by the region of the spine that surgeons name a curve after."""
_SIDEWAYS = math.cos(math.radians(30.0))
"""Skin that faces within 30 degrees of sideways is flank; of up or down, it is no region's."""


@dataclass(frozen=True, eq=False)
class Regions:
    """Where the vertices of a skin lie, and how much of it each stands for."""

    band: np.ndarray
    """Number of the band in `BANDS` by the nearest vertebra, -1 above T1, below L5 or facing up or down; (n,)."""
    to_left: np.ndarray
    """True left of the spine, as it runs at that height, shape (n,)."""
    facing: np.ndarray
    """1 where the skin faces back, -1 front, 0 sideways, shape (n,)."""
    area: np.ndarray
    """Area of the skin around each vertex [mm2], shape (n,)."""

    @cached_property
    def masks(self) -> dict[str, np.ndarray]:
        """The vertices of each region by name, (n,) bool: back, front and flanks, then the parts of each band."""
        inside = self.band >= 0
        back, flank = self.facing == 1, self.facing == 0
        mask_of = {"back": inside & back, "front": inside & (self.facing == -1), "flanks": inside & flank}
        for number, band in enumerate(BANDS):
            for part, faces in (("back", back), ("flank", flank)):
                for side, where in (("left", self.to_left), ("right", ~self.to_left)):
                    mask_of[f"{band}, {part} {side}"] = (self.band == number) & faces & where
        return mask_of


def regions_of(skin: Surface, landmarks: Landmarks) -> Regions:
    """Sort the vertices of a skin into regions.

    Skin is back or front by where its normal points in the axes of the pelvis, and flank within 30 degrees of
    sideways: there the arms are cut off, so that flanks may hold a cut plane and back and front never do. Skin
    that faces within 30 degrees of up or down (shoulders, the cuts through neck and thighs) is in no region.

    Args:
        skin: the surface [mm], oriented outward.
        landmarks: those of the spine and the pelvis that go with it [mm].

    Raises:
        InputError: no ASIS, or no vertebra, among the landmarks.
    """
    across, spine = asis_axis(landmarks), spine_of(landmarks)
    behind = np.array([-across[1], across[0]])
    judged = [i for i, level in enumerate(spine.levels) if any(level in levels for levels in BANDS.values())]
    if not judged:
        raise InputError(
            "landmarks: no vertebra from T1 to L5 has a landmark; regions are assigned by the nearest one"
        )
    centroids = spine.centroids[judged]
    level = _nearest_level(skin.vertices[:, 2], centroids[:, 2])
    number = {name: i for i, names in enumerate(BANDS.values()) for name in names}
    bands = np.array([*(number[spine.levels[i]] for i in judged), -1])
    normals = vertex_normals(skin)
    upward = np.argsort(centroids[:, 2])
    heights, line = centroids[upward, 2], centroids[upward, :2]
    middle = np.column_stack([np.interp(skin.vertices[:, 2], heights, line[:, axis]) for axis in (0, 1)])
    level_side = unit(normals[:, :2])
    facing = np.where(np.abs(level_side @ across) > _SIDEWAYS, 0, np.sign(level_side @ behind))
    return Regions(
        band=np.where(np.abs(normals[:, 2]) > _SIDEWAYS, -1, bands[level]),
        to_left=((skin.vertices[:, :2] - middle) @ across) > 0.0,
        facing=facing.astype(np.int8),
        area=corner_areas(skin),
    )


def _nearest_level(height: np.ndarray, centroids: np.ndarray) -> np.ndarray:
    """Which centroid is nearest in height; -1 more than half a vertebra above the top or below the bottom."""
    order = np.argsort(centroids)
    sorted_heights = centroids[order]
    nearest = order[np.searchsorted((sorted_heights[1:] + sorted_heights[:-1]) / 2.0, height)]
    half = np.diff(sorted_heights)[[0, -1]] / 2.0 if len(centroids) > 1 else np.full(2, 15.0)
    outside = (height < sorted_heights[0] - half[0]) | (height > sorted_heights[-1] + half[1])
    return np.where(outside, -1, nearest)


_DISTANCES = [field.name for field in fields(DistanceStatistics) if field.name != "area"]
RANGES = {
    f"{first}-{last}": VERTEBRAE[VERTEBRAE.index(first) : VERTEBRAE.index(last) + 1]
    for first, last in (("T4", "T12"), ("T3", "L5"), ("T3", "T12"), ("L1", "L5"))
}
"""Levels over which the papers judge: T4-T12 in [2]; T3-L5, and of it the thoracic and lumbar part, in [1]."""


@dataclass(frozen=True)
class BsrError:
    """Error of the back surface rotation over some levels [degrees]."""

    levels: tuple[str, ...]
    """Levels where both skins have a rotation."""
    mean: float
    """Mean absolute difference."""
    sd: float | None
    """Standard deviation of the absolute differences (of a sample, n - 1); None for one level."""
    of_maximum: float
    """The rotation where the actual skin has its largest, predicted less actual, positive where the prediction has
    more to the same side."""

    @property
    def undetectable(self) -> bool:
        """Whether the mean is below the smallest detectable difference, which both papers ask for."""
        return self.mean < DETECTABLE


@dataclass(frozen=True, eq=False)
class SkinComparison:
    """A predicted skin against the actual one."""

    bsr_difference: dict[str, float | None]
    """Back surface rotation by level, predicted less actual [degrees]; None where one of them is missing."""
    bsr_error: dict[str, BsrError | None]
    """Error by the ranges of `RANGES`; None where no level of a range is known."""
    distance: dict[str, DistanceStatistics | None]
    """Distances by region (`Regions.masks`), positive where the prediction lies outside the actual skin."""
    signed_distance: np.ndarray
    """Distance [mm] of each vertex of the prediction from the actual skin, positive outside, shape (n,)."""
    counted: np.ndarray
    """False for vertices that the statistics leave out: cut planes, and what is above T1 or below L5; (n,)."""


@checked
def compare_skins(
    predicted: Surface,
    actual: Surface,
    landmarks: Landmarks,
    rotations: tuple[Rotations, Rotations] | None = None,
) -> SkinComparison:
    """Judge a predicted skin by the actual one, as both papers do and in millimetres.

    Both must be closed and in one frame; they need not share vertices or triangles, nor be cut at the same
    neck, arms and thighs (`skin_distance`). Nothing is registered here: a difference in posture counts.

    >>> errors = wt.compare_skins(result.skin, result.skin, result.landmarks_after)  # against itself
    >>> errors.distance["back"].mean
    0.0

    Args:
        predicted: the simulated skin [mm].
        actual: the skin as scanned after surgery [mm].
        landmarks: those after surgery, used for both skins [mm].
        rotations: of the predicted and of the actual back by level [degrees], as `TrunkMeasures.bsr` has them;
            measured when left out.

    Raises:
        InputError: no ASIS, or no vertebra, among the landmarks, or a skin that is open at a level.
    """
    for name, skin in (("predicted", predicted), ("actual", actual)):
        check_surface(skin, f"compare_skins: '{name}'")
    ours, actual_rotations = rotations or (
        {level: tangent and tangent.angle for level, tangent in back_surface_rotation(skin, landmarks).items()}
        for skin in (predicted, actual)
    )
    angles = {
        level: None if angle is None or (other := actual_rotations[level]) is None else (angle, other)
        for level, angle in ours.items()
    }
    distance = skin_distance(predicted, actual, landmarks)
    return SkinComparison(
        bsr_difference={level: None if pair is None else pair[0] - pair[1] for level, pair in angles.items()},
        bsr_error={name: bsr_error(angles, levels) for name, levels in RANGES.items()},
        distance=distance_statistics(distance, skin_distance(actual, predicted, landmarks)),
        signed_distance=distance.signed,
        counted=distance.counted,
    )


def comparison_rows(comparison: SkinComparison) -> list[Measured]:
    """A prediction against the actual skin as rows of the state `error`, without its values by vertex.

    Levels are vertebrae, ranges of `RANGES`, and regions of the skin; a number that is missing is None.
    """
    rows = [("bsr_deg", level, difference) for level, difference in comparison.bsr_difference.items()]
    for name, error in comparison.bsr_error.items():
        rows += [
            (f"bsr_error_{part}_deg", name, error and getattr(error, part))
            for part in ("mean", "sd", "of_maximum")
        ]
    for region, statistics in comparison.distance.items():
        rows.append(("area_cm2", region, statistics and statistics.area))
        rows += [(f"distance_{part}_mm", region, statistics and getattr(statistics, part)) for part in _DISTANCES]
    return [Measured("error", level, quantity, value) for quantity, level, value in rows]


def bsr_error(angles: Mapping[str, tuple[float, float] | None], levels: tuple[str, ...]) -> BsrError | None:
    """Error of the predicted rotations over some levels, from predicted and actual by level [degrees]."""
    pairs = {level: pair for level in levels if (pair := angles.get(level)) is not None}
    if not pairs:
        return None
    predicted, actual = np.array(list(pairs.values())).T
    size, largest = np.abs(predicted - actual), int(np.abs(actual).argmax())
    return BsrError(
        levels=tuple(pairs),
        mean=float(size.mean()),
        sd=float(size.std(ddof=1)) if len(size) > 1 else None,
        of_maximum=float(np.copysign(1.0, actual[largest]) * (predicted - actual)[largest]),
    )
