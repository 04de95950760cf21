"""Indices of a funnel chest, where a case has a sternum, ribs and a thoracic vertebra."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from warp_trunk.case.anatomy import region
from warp_trunk.geometry.surface import Surface

_STEP = 5.0
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


def chest_indices(skin: Surface, bones: Mapping[str, Surface]) -> dict[str, float]:
    """The indices of a chest at the height where the lower half of the sternum is nearest to the spine.

    - Haller index: the largest inner width of the chest over the smallest distance between sternum and vertebra
      (Haller, Kramer and Lietman, J. Pediatr. Surg. 22, 1987, 904-906).
    - Correction index: 100 (b - a) / b with that smallest distance a and the largest distance b from the front of
      the vertebra to the inside of the front wall (St. Peter et al., J. Pediatr. Surg. 46, 2011, 2270-2273).
    - External sternal angle: the inclination to the vertical of the skin over the midline of the sternum, by a
      straight line fitted to it; positive where its lower end lies further forward.

    Args:
        skin: the skin in LPS [mm].
        bones: bones by name, in the same state.

    Returns:
        The indices by name and unit; none without a sternum, both sides of ribs and a vertebra at that height.
    """
    thoracic = [bones[name].vertices for name in bones if region(name) == "T"]
    wall = [bones[name].vertices for name in bones if name.startswith(_WALL)]
    if "sternum" not in bones or not thoracic or not wall:
        return {}
    sternum, spine, ribs = bones["sternum"].vertices, np.vstack(thoracic), np.vstack(wall)
    middle = float(np.median(sternum[:, 0]))
    body = spine[np.abs(spine[:, 0] - middle) < _MIDLINE]
    central = sternum[np.abs(sternum[:, 0] - middle) < _MIDLINE]
    depths = {}
    low, high = sternum[:, 2].min(), sternum[:, 2].max()
    for height in np.arange(low + _STEP, 0.5 * (low + high), _STEP):
        front, back = (_slab(points, height, _STEP)[:, 1] for points in (body, central))
        if len(front) and len(back):
            depths[height] = float(front.min() - back.max()), float(front.min())
    if not depths:
        return {}
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
        return {}
    furthest = max(vertebra - min(inner), nearest)
    return {
        "Haller index": max(widths) / nearest,
        "Correction index [%]": 100.0 * (furthest - nearest) / furthest,
        "External sternal angle [°]": math.degrees(math.atan(float(np.polyfit(line[:, 2], line[:, 1], 1)[0]))),
    }


def _slab(points: np.ndarray, height: float, half: float) -> np.ndarray:
    return points[np.abs(points[:, 2] - height) < half]


def _columns(values: np.ndarray) -> list[np.ndarray]:
    """Which values (n,) lie in each column of width `_COLUMN`, shape (n,) bool each."""
    number = np.floor(values / _COLUMN)
    return [number == one for one in np.unique(number)]
