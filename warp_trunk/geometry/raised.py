"""Hair, straps and clothes that stand on a back, and the skin under them: a back is smooth across."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

CREASE = 2.0
"""The skin bends to the inside by less than this over `CREASE_REACH` to both sides, or there is a crease [mm]."""
CREASE_REACH = 8.0
"""Over this way to both sides creases are looked for [mm]."""
RAISED = 2.0
"""A piece that a crease surrounds stands on the back if it is higher than this above the skin around it [mm]."""
BESIDE = 160.0
"""It is looked for within this distance of the spine [mm]."""
_LARGE = 250.0
"""A smaller piece between creases is noise [mm^2]."""
_AROUND = 32.0
"""Skin this far around gives the skin under what is raised [mm] ..."""
_STIFF = 5.0
"""... as a plate that follows details longer than about six times this [mm]; ..."""
_STIFFER = 12.0
"""... and a plate that follows longer ones only shows what stands on the skin [mm]."""
_NARROW = (3, 2, 1, 0)
"""Pieces are cut where they are narrower than twice as many cells."""
_FAINTER = (0.75,)
"""Parts of `CREASE` that also count where the depth was smoothed."""
_MOST_RAISED_SHARE = 0.4
"""A piece that is a larger part of a back than this does not stand on it."""
_WEAK = 0.6
"""A crease goes on where the skin bends by more than this part of what begins one."""
_ROUNDS = 3
_CLOSED = 3
"""Gaps in it narrower than twice as many cells are of it."""
_WIDER = 1
"""A piece between creases that is wider than twice as many cells may be of what stands beside it, as a hand."""
_FOOT = 12.0
"""The foot of what is raised may lie this far beyond its crease [mm]."""


@dataclass(frozen=True, eq=False)
class DepthGrid:
    """The depth of a back in square cells, seen from behind."""

    depth: np.ndarray
    """How far back the skin is in each cell [mm], shape (columns, rows); NaN where nothing was seen."""
    origin: np.ndarray
    """The corner of the first cell, to the left and up [mm], shape (2,)."""
    cell: float
    """Side of a cell [mm]."""

    def cells(self, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Column and row of points given to the left and up (n, 2), of the nearest cell where they lie beside."""
        place = np.floor((seen - self.origin) / self.cell).astype(np.int64)
        column, row = np.clip(place, 0, np.array(self.depth.shape) - 1).T
        return column, row

    @property
    def middles(self) -> tuple[np.ndarray, np.ndarray]:
        """Where columns and rows have their middles, to the left and up [mm]."""
        columns, rows = (np.arange(count) + 0.5 for count in self.depth.shape)
        return self.origin[0] + self.cell * columns, self.origin[1] + self.cell * rows


def depth_grid(seen: np.ndarray, depth: np.ndarray, cell: float) -> DepthGrid:
    """The mean depth (n,) of points given to the left and up (n, 2), in cells of a size [mm]; single empty cells
    between full ones have the mean of those."""
    origin = seen.min(axis=0) - 0.5 * cell
    place = np.floor((seen - origin) / cell).astype(np.int64)
    count, total = (np.zeros(place.max(axis=0) + 1) for _ in range(2))
    np.add.at(count, tuple(place.T), 1.0)
    np.add.at(total, tuple(place.T), depth)
    mean = np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0.0)
    return DepthGrid(_filled(mean), origin, cell)


def _filled(depth: np.ndarray) -> np.ndarray:
    """Empty cells with full ones on opposite sides have the mean of those."""
    padded = np.pad(depth, 1, constant_values=np.nan)
    beside = [
        0.5 * (_moved(padded, *step) + _moved(padded, -step[0], -step[1]))
        for step in ((1, 0), (0, 1), (1, 1), (1, -1))
    ]
    full = np.isfinite(beside)
    mean = np.where(full, beside, 0.0).sum(axis=0) / np.maximum(full.sum(axis=0), 1)
    return np.where(np.isnan(depth) & full.any(axis=0), mean, depth)


def _moved(padded: np.ndarray, columns: int, rows: int, pad: int = 1) -> np.ndarray:
    """The cells that lie columns and rows beside those inside the padding."""
    wide, high = (count - 2 * pad for count in padded.shape)
    return padded[pad + columns : pad + columns + wide, pad + rows : pad + rows + high]


def _averaged(depth: np.ndarray) -> np.ndarray:
    """Each cell averaged with those beside it, NaN where it is empty itself."""
    from scipy.ndimage import gaussian_filter

    full = np.isfinite(depth)
    weight = gaussian_filter(full.astype(float), 0.7, mode="constant")
    total = gaussian_filter(np.where(full, depth, 0.0), 0.7, mode="constant")
    return np.divide(total, weight, out=np.full(depth.shape, np.nan), where=full)


def creases(grid: DepthGrid, step: float = CREASE_REACH) -> np.ndarray:
    """How far the skin bends to the inside at each cell, over a step to both sides, in the direction in which it
    does most [mm]; -inf where it is not known."""
    straight = max(1, round(step / grid.cell))
    aslant = max(1, round(step / grid.cell / np.sqrt(2.0)))
    depth = _averaged(grid.depth)
    padded = np.pad(depth, straight, constant_values=np.nan)
    most = np.full(grid.depth.shape, -np.inf)
    for column, row in ((straight, 0), (0, straight), (aslant, aslant), (aslant, -aslant)):
        sides = _moved(padded, column, row, straight) + _moved(padded, -column, -row, straight)
        most = np.fmax(most, sides - 2.0 * depth)
    return most


@dataclass(frozen=True, eq=False)
class Raised:
    """The cells of a back on which something stands."""

    grid: DepthGrid
    """The back."""
    reach: np.ndarray
    """Cells in which it may end, and in which it is, bool, shape (columns, rows)."""
    inner: np.ndarray
    """Those of them in which it is."""
    skin: np.ndarray
    """Depth of the skin in and around them, as a bridge [mm], shape (columns, rows); NaN elsewhere."""

    @property
    def cells(self) -> np.ndarray:
        """Cells that it fills, bool, shape (columns, rows)."""
        return self.inner | (self.reach & (self.grid.depth > self.skin + 0.5 * RAISED))

    def over_skin(self, seen: np.ndarray, depth: np.ndarray, error: float) -> tuple[np.ndarray, np.ndarray]:
        """Which points stand on the skin, bool, shape (n,), and the depth of the skin under them [mm], shape (n,).

        Args:
            seen: points, to the left and up, shape (n, 2) [mm].
            depth: how far back they are, shape (n,) [mm].
            error: standard deviation of their depth [mm].
        """
        from scipy.ndimage import map_coordinates

        cell = self.grid.cells(seen)
        place = ((seen - self.grid.origin) / self.grid.cell - 0.5).T
        skin = map_coordinates(self.skin, place, order=1, mode="nearest")
        skin = np.where(np.isnan(skin), self.skin[cell], skin)
        on = self.inner[cell] | (self.reach[cell] & (depth > skin + 0.5 * RAISED + 2.0 * error))
        return on & np.isfinite(skin), skin


def find_raised(grid: DepthGrid, aside: np.ndarray, error: float = 0.0, blur: float = 0.0) -> Raised | None:
    """Find what stands on a back: pieces of it that creases surround, and that stand above the skin around them.

    Hair, straps and clothes end in a step or a crease on all sides; the skin has folds and edges of bones, but
    none that surround a piece which is higher than a smooth bridge between its surroundings.

    Args:
        grid: of the back.
        aside: how far each cell lies to the left of the spine [mm], shape (columns, rows).
        error: standard deviation of the depth of a cell [mm].
        blur: over what way the depth was smoothed [mm].

    Returns:
        None where nothing stands on it.
    """
    from scipy import ndimage  # heavy

    near = np.isfinite(grid.depth) & (np.abs(aside) < BESIDE)
    step = max(CREASE_REACH, blur)
    bend = creases(grid, step) / (CREASE * step / CREASE_REACH + error)
    skin, raised = np.zeros(near.shape, dtype=bool), np.zeros(near.shape, dtype=bool)
    # a crease that is interrupted over a short way, or that was smoothed, still ends a piece
    for least, narrow in product((1.0, *(_FAINTER if blur else ())), _NARROW):
        part = ~_hysteresis(bend, _WEAK * least, least) & near & ~raised
        solid = part
        if narrow:
            solid = np.logical_and(ndimage.binary_erosion(part | ~near, iterations=narrow, border_value=1), near)
        piece = np.empty(near.shape, dtype=np.int32)
        ndimage.label(solid & part, output=piece)
        size = np.bincount(piece.ravel()) * grid.cell**2
        order = [number for number in np.argsort(-size[1:]) + 1 if size[number] > _LARGE]
        if len(order) < 2:
            continue
        gap, nearest = np.empty(near.shape), np.empty((2, *near.shape), dtype=np.int32)
        ndimage.distance_transform_edt(piece == 0, return_indices=True, distances=gap, indices=nearest)
        grown = np.where(part & (gap <= narrow + 1.0), piece[tuple(nearest)], 0)
        skin = grown == order[0]
        for number in order[1:]:
            piece_cells = grown == number
            large = piece_cells.sum() > _MOST_RAISED_SHARE * near.sum()
            if not large and min(heights(grid, skin, piece_cells)) > RAISED + 3.0 * error:
                raised |= piece_cells
            else:
                skin |= piece_cells
    if not raised.any():
        return None
    # it goes on to the rim of the scan where it comes near to it
    beyond = raised | (~near & _dilated(raised, _CLOSED))
    raised = np.logical_or(raised, ndimage.binary_closing(beyond, iterations=_CLOSED))
    raised = np.asarray(ndimage.binary_fill_holes(raised), dtype=bool) & near
    beside = _dilated(raised, _CLOSED)
    rest = ndimage.binary_opening(near & ~skin & ~raised, iterations=_WIDER)
    whole = np.asarray(ndimage.binary_propagation(beside, mask=beside | rest), dtype=bool)
    reach = _dilated(whole, round(_FOOT / grid.cell)) & near
    standing = Raised(grid, reach, raised, bridge(grid, near & ~reach, reach))
    for _ in range(_ROUNDS - 1):  # skin beside the foot carries the bridge, too
        standing = replace(standing, skin=bridge(grid, near & ~standing.cells, reach))
    return standing


def _hysteresis(values: np.ndarray, weak: float, strong: float) -> np.ndarray:
    """Cells above a weak threshold that hang together with one above a strong one, bool (Canny 1986, IEEE Trans
    Pattern Anal Mach Intell 8:679)."""
    from scipy import ndimage

    piece = np.empty(values.shape, dtype=np.int32)
    ndimage.label(values >= weak, np.ones((3, 3)), output=piece)
    strong_pieces = np.unique(piece[values >= strong])
    return np.isin(piece, strong_pieces[strong_pieces > 0])


def _dilated(cells: np.ndarray, times: int) -> np.ndarray:
    """Cells and their neighbours up to so many cells away, bool, shape (columns, rows)."""
    from scipy import ndimage

    return np.asarray(ndimage.binary_dilation(cells, iterations=times), dtype=bool)


def heights(grid: DepthGrid, skin: np.ndarray, part: np.ndarray) -> tuple[float, float]:
    """How high a part stands above the skin [mm].

    In the median above a bridge from the skin around it, and by the step between both if they go on smoothly
    but for it.
    """
    plate = _Plate(grid, part, skin, _STIFFER)
    if plate.on_skin.sum() < 3:
        return 0.0, 0.0
    own = plate.of(part)
    low = plate.solved(plate.on_skin, plate.depth)
    above = float(np.median((plate.depth - low)[own]))
    both = plate.on_skin | own
    level, step = (plate.left(both, values) for values in (plate.depth, own.astype(float)))
    return above, float(level @ step / (step @ step))


def bridge(grid: DepthGrid, skin: np.ndarray, part: np.ndarray) -> np.ndarray:
    """The depth of the skin under a part of the back as a thin plate that the skin around it carries.

    Args:
        grid: of the back.
        skin: cells that are skin, bool, shape (columns, rows).
        part: cells to bridge, bool.

    Returns:
        The depth there and `_AROUND` it [mm], shape (columns, rows); NaN elsewhere.
    """
    plate = _Plate(grid, part, skin, _STIFF)
    depth = np.full(part.shape, np.nan)
    depth[plate.inside] = plate.solved(plate.on_skin, plate.depth) + plate.level
    return depth


class _Plate:
    """A thin plate over a part of a back and `_AROUND` it.

    It minimises the squared distances from the cells that carry it, plus the fourth power of a length times the
    integral of its squared second derivatives; beyond them it goes on straight.
    """

    def __init__(self, grid: DepthGrid, part: np.ndarray, skin: np.ndarray, stiff: float) -> None:
        from scipy.sparse import coo_array, vstack

        self.inside = inside = _dilated(part, round(_AROUND / grid.cell))
        self.on_skin = skin[inside]
        depth = grid.depth[inside]
        self.level = float(np.nanmean(depth))
        self.depth = np.nan_to_num(depth - self.level)
        number = np.full(part.shape, -1)
        number[inside] = np.arange(len(depth))
        padded, blocks = np.pad(number, 1, constant_values=-1), []
        for stencil in (
            {(-1, 0): 1.0, (0, 0): -2.0, (1, 0): 1.0},
            {(0, -1): 1.0, (0, 0): -2.0, (0, 1): 1.0},
            {(0, 0): 2.0**0.5, (1, 0): -(2.0**0.5), (0, 1): -(2.0**0.5), (1, 1): 2.0**0.5},
        ):
            columns = np.stack([_moved(padded, *step)[inside] for step in stencil], axis=1)
            columns = columns[(columns >= 0).all(axis=1)]
            rows = np.repeat(np.arange(len(columns)), len(stencil))
            values = np.tile(list(stencil.values()), len(columns))
            blocks.append(coo_array((values, (rows, columns.ravel())), shape=(len(columns), len(depth))))
        self.bend = (stiff / grid.cell) ** 2 * vstack(blocks).tocsr()

    def of(self, cells: np.ndarray) -> np.ndarray:
        """Some cells of the grid among those of the plate."""
        return cells[self.inside]

    def solved(self, carried: np.ndarray, values: np.ndarray) -> np.ndarray:
        """The plate that some of its cells carry at some values."""
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import spsolve

        matrix = diags_array(carried + 1e-9) + self.bend.T @ self.bend
        return np.asarray(spsolve(matrix.tocsc(), np.where(carried, values, 0.0)))

    def left(self, carried: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Distances of the plate from its values and how it bends: its energy is the square of this."""
        solution = self.solved(carried, values)
        return np.concatenate([(solution - values)[carried], self.bend @ solution])
