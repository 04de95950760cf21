"""The scan of a back: points, their normals, and where it ends; and what a scan of a whole body would be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.back_points import find_back
from warp_trunk.geometry.scanned_points import in_cubes
from warp_trunk.geometry.surface import area_vectors, unit
from warp_trunk.spine.spine import asis_axis

from ..deformity.patient_spine import PatientSpine, spine_line
from ..deformity.spine_curve import endplates_of
from .body import posterior_spines

FEWEST_SEEN = 2000
"""A scan of fewer points shows no back."""
EXTENT = (250.0, 10000.0)
"""The largest extent of a scan with its surroundings is between these [mm]."""
_NEIGHBOURS = 24
_AT_RIM = 0.35
"""At the rim of a scan the middle of the points around one is off by more than this part of their distance."""


@dataclass(frozen=True, eq=False)
class BackScan:
    """Points of the skin of the back in LPS axes."""

    points: np.ndarray
    """Averaged in cubes of `SPACING` [mm], shape (n, 3)."""
    normals: np.ndarray
    """Outward, of length 1, shape (n, 3)."""
    areas: np.ndarray
    """Of the skin that each point stands for [mm^2], shape (n,)."""
    rim: np.ndarray
    """Whether the scan ends there, bool, shape (n,)."""
    points_read: int
    """How many points were read."""
    stray: np.ndarray
    """Surroundings, and markers, straps and hair on the skin [mm], shape (m, 3)."""
    noise: float
    """Standard deviation of the points about the skin [mm]."""

    def chosen(self, chosen: np.ndarray) -> BackScan:
        """The scan of the points that are kept, bool, shape (n,)."""
        rows = self.points[chosen], self.normals[chosen], self.areas[chosen], self.rim[chosen]
        return BackScan(*rows, self.points_read, self.stray, self.noise)

    def carried(self, carry: Callable[[np.ndarray], np.ndarray], rotation: np.ndarray) -> BackScan:
        """The scan in another frame: points by a map, normals by its rotation (3, 3)."""
        normals = self.normals @ rotation.T
        return replace(self, points=carry(self.points), normals=normals, stray=carry(self.stray))


def clean_scan(points: np.ndarray, inner: np.ndarray, what: str = "back", spine: str = "spine") -> BackScan:
    """Find the skin of the back (`find_back`), leave out its surroundings and what stands on it, and find normals.

    Args:
        points: as read, in mm and LPS, shape (n, 3).
        inner: points inside the body from top to bottom, such as the line of the spine: normals point away from
            it, shape (m, 3) [mm].
        what: name of the scan in an error.
        spine: name of `inner` in an error.

    Raises:
        InputError: fewer than `FEWEST_SEEN` points, a scan that is too large or too small for a back in mm, or one
            that does not lie behind the spine.
    """
    from scipy.spatial import KDTree  # heavy

    if len(points) < FEWEST_SEEN:
        cure = "give the whole scan, without thinning it"
        raise InputError(f"{what}: a back needs {FEWEST_SEEN} points, and there are {len(points)}; {cure}")
    extent = float(np.ptp(points, axis=0).max())
    if not EXTENT[0] <= extent <= EXTENT[1]:
        fits = [f"--units {unit}" for unit, size in (("cm", 10.0), ("m", 1000.0)) if 250 <= extent * size <= 2500]
        rule = f"a back in mm extends over 250 to 2500, and its surroundings to {EXTENT[1]:g}"
        raise InputError(f"{what}: extends over {extent:.4g}, and {rule}; give {(*fits, 'it in mm')[0]}")
    try:
        back = find_back(points, inner, np.array([1.0, 0.0]), what)
    except InputError:
        check_inside(in_cubes(points)[0], inner, what, spine)
        raise
    thin = back.skin[~back.bridged]
    if not back.smoothed:  # the front of a body that was scanned from all sides belongs to it
        thin = np.vstack([thin, back.hidden])
    stray = np.vstack([back.raised, back.surroundings])
    distance, near = KDTree(thin).query(thin, k=min(_NEIGHBOURS, len(thin)))
    around = thin[near] - thin[near].mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))[1][:, :, 0]
    inside = inner[np.argsort(inner[:, 2])]
    middle = np.column_stack([np.interp(thin[:, 2], inside[:, 2], inside[:, axis]) for axis in (0, 1)])
    outward = np.einsum("ni,ni->n", normals[:, :2], thin[:, :2] - middle)
    normals *= np.where(outward < 0.0, -1.0, 1.0)[:, None]
    reach = distance[:, -1]
    off = np.linalg.norm(thin[near].mean(axis=1) - thin, axis=1)
    return BackScan(
        points=thin,
        normals=normals,
        areas=np.pi * reach**2 / distance.shape[1],
        rim=off > _AT_RIM * reach,
        points_read=len(points),
        stray=stray,
        noise=back.noise,
    )


def check_inside(points: np.ndarray, line: np.ndarray, back: str, spine: str) -> None:
    """InputError where the spine does not lie in front of the skin of a back."""
    from scipy.spatial import KDTree  # heavy

    inner = line[(line[:, 2] > points[:, 2].min()) & (line[:, 2] < points[:, 2].max())]
    if len(inner) < 3:
        cure = "give both in one frame, in mm and LPS"
        raise InputError(f"{spine}: has {len(inner)} points at the heights of the scan {back}; {cure}")
    gap, near = KDTree(points[:, [0, 2]]).query(inner[:, [0, 2]])
    beside = int(np.argmax(gap))
    if gap[beside] > 60.0:
        cure = "give both in one frame, in mm and LPS"
        raise InputError(f"{spine}: lies {gap[beside]:.0f} mm beside the scan {back}; {cure}")
    depth = float(np.median(points[near, 1] - inner[:, 1]))
    if depth < 0.0:
        cure = "scan the back, or turn the axes to LPS with +y to the back"
        raise InputError(
            f"{back}: lies {-depth:.0f} mm in front of the spine, so it is a scan of the front; {cure}"
        )
    if not 15.0 <= depth <= 180.0:
        rule = (
            f"{spine}: lies outside the body, {depth:.0f} mm in front of the skin of the back (15 to 180 is usual)"
        )
        raise InputError(f"{rule}; give spine and scan in one frame, in mm")


_FACING = -0.15
"""A scanner sees skin whose normal points forward by less than this."""
_ABOVE, _BELOW = 15.0, 30.0
"""The scan reaches this far above C7 and below the iliac spines [mm]."""
_BESIDE = 170.0
"""And this far to either side of the middle [mm]; what is beyond are arms."""
_NOISE = 0.3
"""Standard deviation of a point along the normal [mm]."""
_POINT_AREA = 9.0
"""Area of skin for each point [mm^2]."""


def cut_back(case: Case) -> tuple[np.ndarray, PatientSpine, Landmarks]:
    """Points of the back of a whole body with a scanner's noise, the line of its spine, and its markers.

    Args:
        case: a trunk with a spine and hip bones.

    Returns:
        Points (n, 3) [mm], the line through the bodies from C7 down, and C7, PSIS_left and PSIS_right.
    """
    skin, landmarks = case.skin, case.landmarks_before
    psis = posterior_spines(skin, case.bones, asis_axis(landmarks))
    rng = np.random.default_rng(0)
    ends = endplates_of(landmarks)
    vectors = area_vectors(skin.vertices, skin.faces)
    area, normal = np.linalg.norm(vectors, axis=1), unit(vectors)
    face = rng.choice(len(area), int(area.sum() / _POINT_AREA), p=area / area.sum())
    weights = rng.dirichlet(np.ones(3), len(face))
    points = np.einsum("nk,nki->ni", weights, skin.vertices[skin.faces[face]])
    top, x = ends[0, 0], points[:, 0] - psis[:, 0].mean()
    seen = (
        (normal[face, 1] > _FACING) & (points[:, 2] < top[2] + _ABOVE) & (points[:, 2] > psis[:, 2].min() - _BELOW)
    )
    seen &= np.abs(x) < _BESIDE
    behind = points[seen & (np.abs(points[:, 2] - top[2]) < 6.0) & (np.abs(points[:, 0] - top[0]) < 6.0)]
    markers = Landmarks(("C7", "PSIS_left", "PSIS_right"), np.vstack([behind.mean(axis=0), psis]))
    line = np.vstack([2.0 * ends[0, 0] - ends[0, 1], ends.mean(axis=1), ends[-1, 1]])
    noisy = points[seen] + rng.normal(0.0, _NOISE, int(seen.sum()))[:, None] * normal[face[seen]]
    return noisy, spine_line(line), markers
