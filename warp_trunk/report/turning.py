"""The trunk to turn on a page: its states packed for `turning.js`.

A viewer of our own of 13 kB: model-viewer (1 MB) has no wipe and no colour by a number, three.js and vtk.js need a
bundler and bring most of a megabyte that is not used here, and plotly 4.8 MB. Pages stay one file that runs
offline.
"""

from __future__ import annotations

import base64
import hashlib
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np

from warp_trunk.geometry.surface import directed_edges
from warp_trunk.views.clothing import SHORTS_FACES, cloth_faces, open_back
from warp_trunk.views.hump import SCALE_END, hump_palette

ROUNDED_TO = 0.04
"""Places are rounded to this [mm]."""


@dataclass(frozen=True, eq=False)
class TurningState:
    """One state of a trunk that is to be turned, in the axes of the pelvis: +x left, +y back, +z up."""

    name: str
    """Its name on the page."""
    skin: np.ndarray
    """Vertices [mm], shape (vertices, 3)."""
    cloth: np.ndarray
    """Those of its cloth (`cloth_of`) [mm], shape (rows, columns, 3)."""
    hump: np.ndarray
    """How far each vertex stands behind the other side of the back [mm], shape (vertices,) ..."""
    part: np.ndarray
    """... and how strongly that is painted, 0 to 1, same shape."""


@dataclass(frozen=True, eq=False)
class Turning:
    """The values of the template `turning.html`."""

    info: dict[str, Any]
    """Names of the states and numbers of the packed data."""
    data: str
    """The packed data, as base64."""
    bare: bool
    """Whether it may be shown without clothes."""


def turning(
    states: Sequence[TurningState],
    faces: np.ndarray,
    *,
    colours: np.ndarray | None = None,
    unseen: np.ndarray | None = None,
    bare: bool,
) -> Turning:
    """Pack states that share their triangles.

    Args:
        states: the first is blended into any other.
        faces: triangles of the skin, shape (faces, 3).
        colours: of each vertex of the skin, uint8, shape (vertices, 3); grey when left out.
        unseen: 1 for each vertex that was not measured, which is hatched, shape (vertices,); None where all were.
        bare: whether the page offers to take the clothes off.
    """
    cloth, count = cloth_faces(), len(states[0].skin)
    every = np.concatenate([np.concatenate([state.skin, state.cloth.reshape(-1, 3)]) for state in states])
    low, high = every.min(axis=0), every.max(axis=0)
    order, faces = _in_order(faces, count)
    packed = []
    for first, places in (
        (faces, [state.skin[order] for state in states]),
        (cloth, [state.cloth.reshape(-1, 3) for state in states]),
    ):
        packed += [first.ravel() & 0xFFFF, first.ravel() >> 16]
        whole = [np.round((place - low) / ROUNDED_TO).astype(np.int64) for place in places]
        for number, place in enumerate(whole):
            packed += list((place - whole[0] * bool(number)).T)
    for state in states:
        packed += [np.round(4.0 * state.hump[order]), np.round(31.0 * state.part[order])]
    packed.append(np.round(10.0 * open_back().ravel()))
    if colours is not None:
        packed += list(colours[order].T)
    if unseen is not None:
        packed.append(np.round(unseen[order]))
    data = zlib.compress(b"".join(map(_folded, packed)), 9)
    info = {
        "states": [state.name for state in states],
        "vertices": count,
        "faces": len(faces),
        "cloth": states[0].cloth.size // 3,
        "clothFaces": len(cloth),
        "shortsFaces": SHORTS_FACES,
        "step": ROUNDED_TO,
        "middle": np.round((high - low) / 2.0, 2).tolist(),
        "size": np.round(high - low, 2).tolist(),
        "palette": np.round(hump_palette(), 4).ravel().tolist(),
        "limit": SCALE_END,
        "coloured": colours is not None,
        "invented": unseen is not None,
    }
    return Turning(info, base64.b64encode(data).decode(), bare)


def _in_order(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices along edges and triangles along vertices, so that differences are small: two thirds of the size.

    Returns:
        The old number of each vertex, shape (vertices,), and the triangles by their new numbers, (faces, 3).
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import depth_first_order

    ends = directed_edges(faces)
    graph = coo_array((np.ones(len(ends[0])), ends), shape=(count, count)).tocsr()
    reached = depth_first_order(graph, int(faces[0, 0]), return_predecessors=False)
    order = np.append(reached, np.setdiff1d(np.arange(count), reached))
    corners = np.argsort(order)[faces]
    first = corners.argmin(axis=1)[:, None]
    corners = np.take_along_axis(corners, (first + np.arange(3)) % 3, axis=1)
    return order, corners[np.lexsort(corners.T[::-1])]


def _folded(values: np.ndarray) -> bytes:
    """Numbers of 16 bits as differences from the one before, folded to be positive: low bytes, then high ones."""
    whole = values.astype(np.int64).astype(np.uint16)
    steps = np.diff(whole, prepend=np.uint16(0)).astype(np.int16).astype(np.int32)
    folded = ((steps << 1) ^ (steps >> 15)).astype(np.uint16)
    return (folded & 0xFF).astype(np.uint8).tobytes() + (folded >> 8).astype(np.uint8).tobytes()


def script() -> tuple[str, str]:
    """The viewer, and its source in a Content-Security-Policy."""
    text = files("warp_trunk.report").joinpath("turning.js").read_text(encoding="utf-8")
    return text, f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
