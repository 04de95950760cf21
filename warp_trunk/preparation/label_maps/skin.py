"""From a CT or the mask of the body to the closed skin of the trunk."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import ASIS
from warp_trunk.errors import InputError
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.geometry.cutting import CutPlane, check_meets, cut_flat
from warp_trunk.geometry.distance_field import Grid, largest_piece, one_solid, zero_surface
from warp_trunk.geometry.surface import Surface, unit, vertex_normals
from warp_trunk.geometry.surface_checks import crossings
from warp_trunk.io.image_files.image_reader import read_scan

from .mask import Mask, depth, distance, factors_below, reduced

_FINE = 2.5
"""The field of the body is kept on blocks of voxels whose sides stay below this [mm]."""
_SMOOTH = 4.0
"""Standard deviation of the Gaussian that takes the stairs off the skin [mm]: where the back runs along the voxels
they are 10 mm wide and more, and turn the back by 0.3 degrees."""
_GRID = 0.65
"""Spacing of the grid on which the surface is drawn, in edge lengths."""
_BEYOND = 25.0
"""The trunk is cut this far above the highest vertebra and below the hip bones [mm]: as the scans of a trunk
end."""
_PAST_BORDER = 12.0
"""Where the image ends, the body goes on for this far [mm], so that it can be cut flat at the border."""
_TOLERANCE = 0.1
"""How far coarsening may move the skin, in edge lengths; it is moved back afterwards."""
_TO_SKIN = 3.0
"""How far a vertex of the coarser surface may be moved back onto the skin [mm]."""
_HALF_STEP = 1.0
"""Half of the distance over which the slope of the field is taken [mm]."""
_BORDER = 2
"""Blocks of the outside around all."""
_BARELY = 1.0
"""A plane that less than this lies beyond [mm] cuts nothing."""
_UPRIGHT = 0.7
"""A plane whose normal is within 45 degrees of the z axis is that of a neck or of the thighs."""
_WIDEST = 80.0
"""No arm reaches further inward from its bone than this [mm]; where the body does, arm and trunk touch."""
_HEAD, _BESIDE, _HANGING = 25.0, 30.0, 0.3
"""The head of a humerus is this large [mm], an arm's plane lies this far beside the bone [mm], and an arm hangs
where its bone points down by more than this cosine."""


def body_skin(
    mask: Mask, bones: Mapping[str, Surface], cuts: Sequence[CutPlane], edge_length: float
) -> tuple[Surface, tuple[CutPlane, ...]]:
    """The outside of the body, cut flat.

    Args:
        mask: the body, arms and legs or not; what is around it, as a table, only where it does not touch.
        bones: surfaces by name [mm]; the highest vertebra and the hip bones say where the trunk ends, humeri where
            the arms begin.
        cuts: where to cut besides; where one is above or below, nothing is cut by itself there.
        edge_length: of the triangles [mm].

    Returns:
        The surface, closed, of one piece, oriented outward [mm], and the planes of its flat ends: neck, thighs,
        arms, and where the image ends.

    Raises:
        InputError: a body of which no clean surface comes.
    """
    planes = [*cuts, *_trunk_ends(bones, cuts), *_image_ends(mask)]
    whole = [plane for plane in planes if math.isinf(plane.radius)]
    arms = [plane for plane in planes if plane not in whole] + _arm_cuts(mask, bones)
    surface, cut = _field(mask, whole, arms).surface(edge_length), []
    try:
        for plane in whole:
            if plane.distance(surface.vertices).max() > _BARELY:
                surface = cut_flat(surface, [plane], edge_length)
                cut.append(plane)
    except InputError:  # an outline that triangles cannot close flat: ends are cut in the voxels and rounded off
        surface, cut = _field(mask, (), [*arms, *whole]).surface(edge_length), whole
    return surface, (*arms, *cut)


def check_cuts(body: Mask, cuts: Sequence[CutPlane]) -> None:
    """InputError for a plane that the box around the body does not reach beyond, or lies beyond altogether."""
    for plane in cuts:
        check_meets(plane, plane.distance(body.corners()) > 0.0, "--cut", "the body")


@dataclass(frozen=True, eq=False)
class _Field:
    """Signed distance to the skin on blocks of voxels, negative inside."""

    values: np.ndarray
    """[mm], shape (i, j, k)."""
    affine: np.ndarray
    """From numbers of blocks to LPS [mm], shape (4, 4)."""

    def at(self, points: np.ndarray) -> np.ndarray:
        """Interpolated at points (n, 3) [mm]; outside of the blocks it is large."""
        from scipy import ndimage  # heavy

        voxels = (points - self.affine[:3, 3]) @ np.linalg.inv(self.affine[:3, :3]).T
        return ndimage.map_coordinates(self.values, voxels.T, order=1, mode="constant", cval=_PAST_BORDER)

    def surface(self, edge_length: float) -> Surface:
        """The zero surface: drawn and coarsened on a grid of its own, then drawn onto this field."""
        corners = np.array(np.meshgrid(*[(0, n - 1) for n in self.values.shape])).reshape(3, -1).T
        corners = corners @ self.affine[:3, :3].T + self.affine[:3, 3]
        spacing = _GRID * edge_length
        lower = corners.min(axis=0) - spacing
        grid = Grid.over(lower, corners.max(axis=0) + spacing, spacing)
        nodes = np.argwhere(np.ones(grid.shape, dtype=bool))
        drawn = self.at(grid.positions(nodes)).reshape(grid.shape).astype(np.float32)
        surface = coarsen(zero_surface(one_solid(drawn, spacing), grid), edge_length, _TOLERANCE * edge_length)
        vertices, normals = surface.vertices, vertex_normals(surface)
        moved = np.zeros(len(vertices))
        for _ in range(3):
            ends = vertices + moved[:, None] * normals
            step = _HALF_STEP * normals
            slope = (self.at(ends + step) - self.at(ends - step)) / (2.0 * _HALF_STEP)
            moved -= self.at(ends) / np.maximum(slope, 0.5)
            moved = np.clip(moved, -_TO_SKIN, _TO_SKIN)
        for share in (1.0, 0.5):
            closer = Surface(vertices + share * moved[:, None] * normals, surface.faces)
            if not len(crossings(closer)):
                return closer
        return surface


def _field(mask: Mask, whole: Sequence[CutPlane], arms: Sequence[CutPlane]) -> _Field:
    """Distance to the skin of the body's largest piece, somewhat past the planes that it will be cut at.

    What the Gaussian takes away is smoothed, too, and given back: that is what is curved (twicing: Tukey,
    Exploratory Data Analysis, 1977).
    """
    from scipy import ndimage  # heavy

    factors = factors_below(_FINE, mask.spacing)
    solid = reduced(mask.inside, factors) >= 0.5
    spacing = mask.spacing * factors
    room = [int(np.ceil(_PAST_BORDER / side)) for side in spacing]
    ends = {(axis, side) for axis, side in mask.faces_at_border() if _is_end(mask, axis)}
    for axis, side in np.ndindex(3, 2):
        width = np.zeros((3, 2), dtype=int)
        width[axis, side] = room[axis]
        solid = np.pad(solid, width, mode="edge" if (axis, side) in ends else "constant")
    affine = mask.affine.copy()
    affine[:3, :3] *= factors
    affine[:3, 3] = mask.place_blocks(-np.array([room]), factors)[0]
    for k in range(solid.shape[2]):  # a layer at a time, for the memory
        voxels = np.argwhere(solid[..., k])
        points = np.column_stack([voxels, np.full(len(voxels), k)]) @ affine[:3, :3].T + affine[:3, 3]
        gone = np.zeros(len(voxels), dtype=bool)
        for plane in whole:
            gone |= plane.distance(points) > _PAST_BORDER
        for plane in arms:
            gone |= plane.near(points) & (plane.distance(points) > 0.0)
        solid[(*voxels[gone].T, k)] = False
    solid = np.asarray(ndimage.binary_fill_holes(np.pad(largest_piece(solid)[0], _BORDER)))
    affine[:3, 3] -= affine[:3, :3] @ np.full(3, _BORDER)
    rough = distance(solid, spacing)
    smooth = ndimage.gaussian_filter(rough, _SMOOTH / spacing)
    return _Field(smooth + ndimage.gaussian_filter(rough - smooth, _SMOOTH / spacing), affine)


def _trunk_ends(bones: Mapping[str, Surface], cuts: Sequence[CutPlane]) -> list[CutPlane]:
    """Above the highest thoracic vertebra and below the hip bones, where nothing was asked for."""
    heights = [cut.unit[2] for cut in cuts if math.isinf(cut.radius)]
    spine = [name for name in VERTEBRAE if name in bones]
    hips = [bones[hip].vertices[:, 2].min() for hip in ASIS.values() if hip in bones]
    planes = []
    if spine[:1] == [VERTEBRAE[0]] and max(heights, default=0.0) <= _UPRIGHT:
        top = float(bones[spine[0]].vertices[:, 2].max()) + _BEYOND
        planes.append(CutPlane((0.0, 0.0, top), (0.0, 0.0, 1.0)))
    if hips and min(heights, default=0.0) >= -_UPRIGHT:
        planes.append(CutPlane((0.0, 0.0, float(min(hips)) - _BEYOND), (0.0, 0.0, -1.0)))
    return planes


def _is_end(mask: Mask, axis: int) -> bool:
    """Whether an axis of the image is that of the patient, from foot to head."""
    return abs(mask.affine[2, axis]) / mask.spacing[axis] > _UPRIGHT


def _image_ends(mask: Mask) -> list[CutPlane]:
    """Where the image ends above or below and the body goes on."""
    planes = []
    for axis, side in mask.faces_at_border():
        if _is_end(mask, axis):
            voxel = (np.array(mask.shape) - 1.0) / 2.0
            voxel[axis] = side * mask.shape[axis] - 0.5
            point = voxel @ mask.affine[:3, :3].T + mask.affine[:3, 3]
            planes.append(CutPlane.at(point, np.linalg.inv(mask.affine[:3, :3])[axis] * (2.0 * side - 1.0)))
    return planes


def _arm_cuts(mask: Mask, bones: Mapping[str, Surface]) -> list[CutPlane]:
    """Planes that take the arms off, where the body has arms and their bones are known.

    A hanging arm is cut along its bone, beside it; a raised one across its bone, above the shoulder.
    """
    planes = []
    for side, left in (("left", 1.0), ("right", -1.0)):
        bone, shoulder = bones.get(f"humerus_{side}"), bones.get(f"scapula_{side}")
        if bone is None or shoulder is None or mask.holds(bone.vertices).mean() <= 0.5:
            continue
        middle = bone.vertices.mean(axis=0)
        along = np.linalg.svd(bone.vertices - middle, full_matrices=False)[2][0]
        along *= np.sign(along @ (middle - shoulder.vertices.mean(axis=0))) or 1.0
        reach = (bone.vertices - middle) @ along
        head, radius = middle + (reach.min() + _HEAD) * along, float(np.ptp(reach))
        if along[2] < -_HANGING:
            normal = unit(np.array([left, 0.0, 0.0]) - left * along[0] * along)
            levels = middle + np.linspace(0.0, 0.8 * reach.max(), 12)[:, None] * along
            planes.append(CutPlane.at(head - _beside(mask, levels, normal) * normal, normal, radius))
        else:
            planes.append(CutPlane.at(head, along, radius + _BESIDE))
    return planes


def _beside(mask: Mask, levels: np.ndarray, normal: np.ndarray) -> float:
    """How far inward from its bone a hanging arm ends [mm], where there is a gap between it and the trunk; without
    a gap it is cut through at `_BESIDE`.

    Args:
        mask: the body.
        levels: points on the axis of the bone, from its middle down [mm], shape (n, 3).
        normal: unit vector to the outside.
    """
    steps = np.arange(0.0, _WIDEST, 1.0)
    inside = mask.holds(levels[:, None] - steps[:, None] * normal)
    if inside.all(axis=1).any():
        return _BESIDE
    return max(_BESIDE, float(steps[inside.argmin(axis=1)].max() + mask.spacing.max()))


AIR = -300.0
"""Voxels denser than this are body [HU]: between lung and fat, as usual for the outline of the body."""
_TABLE = 12.0
"""Parts thinner than this are not body [mm]: tables, blankets, cables."""
_BLOCK = 2.5
"""Blocks of voxels on which the body is looked for have sides below this [mm]."""


def body_in_scan(path: Path) -> Mask:
    """The mask of the body: denser than air, without what is thin, filled layer by layer.

    Returns:
        A mask on blocks of voxels of the scan.

    Raises:
        InputError: a damaged file, or nothing that is as dense as a body.
    """
    from scipy import ndimage  # heavy

    image = read_scan(path)
    affine = image.affine.copy()
    factors = factors_below(_BLOCK, np.linalg.norm(affine[:3, :3], axis=0))
    dense = reduced(image.layers[0] > AIR, factors) >= 0.5
    affine[:3, 3] += affine[:3, :3] @ (0.5 * (np.array(factors) - 1.0))
    affine[:3, :3] *= factors
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    if not dense.any():
        raise InputError(f"{path}: nothing in it is denser than {AIR:g} HU; give a CT in Hounsfield units")
    # the field is padded by copies, so that a body that goes on beyond the image is not thin there
    room = [int(np.ceil(_TABLE / side)) + 1 for side in spacing]
    core = depth(np.pad(dense, [(n, n) for n in room], mode="edge"), spacing) > 0.5 * _TABLE
    opened = depth(~core, spacing) <= 0.5 * _TABLE
    body, _ = largest_piece(opened[tuple(slice(n, -n) for n in room)] & dense)
    axis = int(np.abs(affine[2, :3] / spacing).argmax())  # from foot to head
    for layer in np.moveaxis(body, axis, 0):
        layer[:] = ndimage.binary_fill_holes(layer)  # lungs and bowel, open to the border or not
    return Mask(body, (0, 0, 0), affine, body.shape)
