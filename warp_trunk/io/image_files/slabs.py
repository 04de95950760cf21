"""Voxels read slab by slab from a stream, whatever its header says."""

from __future__ import annotations

import gzip
import io
import math
from collections.abc import Callable
from typing import IO

import numpy as np

MOST_VOXELS = 1_000_000_000
"""No label map or scan has more; 512 x 512 x 900 are 236 millions."""
_MOST_LABEL = 65535
_SLAB = 16_000_000
"""Bytes read at a time."""
_MOST_RATIO = 1100
"""Deflate makes nothing smaller than this many times."""
KINDS = "iuf"
"""Kinds of NumPy types that are read: whole numbers, and floats."""

Convert = Callable[[np.ndarray], np.ndarray]


def open_packed(content: bytes, packed: bool) -> IO[bytes]:
    """A stream of a file's content, unpacked by gzip as it is read."""
    raw = io.BytesIO(content)
    return gzip.GzipFile(fileobj=raw) if packed else raw  # type: ignore[return-value]  # GzipFile is an IO but in name


def read_slabs(
    stream: IO[bytes], shape: tuple[int, ...], kind: np.dtype, left: int, *, packed: bool, convert: Convert
) -> np.ndarray:
    """The voxels of a file, first axis fastest, each slab converted as it comes.

    Args:
        stream: stands at the first voxel.
        shape: of the whole.
        kind: type of a voxel in the file, with its order of bytes.
        left: bytes of the file, as it lies on the disk, that may hold voxels.
        packed: whether gzip packs them.
        convert: gives whole numbers of a small type.

    Raises:
        ValueError: more voxels than the file can hold, or than a scan has; a file that is cut off; what `convert`
            refuses.
    """
    if kind.kind not in KINDS:
        raise ValueError(f"its voxels are of the type {kind}, and numbers are read only")
    if not shape or min(shape) < 1 or math.prod(shape) > MOST_VOXELS:
        raise ValueError(f"its header says {' x '.join(map(str, shape))} voxels, {MOST_VOXELS:.0e} is the most")
    size = math.prod(shape) * kind.itemsize
    if size > left * (_MOST_RATIO if packed else 1):
        raise ValueError(
            f"its header says {size} bytes of voxels, its {left} bytes cannot hold them; it is cut off"
        )
    layer = math.prod(shape[:-1])
    step = max(1, _SLAB // (layer * kind.itemsize))
    result = np.empty(shape, dtype=np.uint8, order="F")
    for first in range(0, shape[-1], step):
        count = min(step, shape[-1] - first)
        slab = convert(np.frombuffer(_exactly(stream, count * layer * kind.itemsize), dtype=kind))
        if slab.dtype != result.dtype:
            wider = np.promote_types(slab.dtype, result.dtype)
            result = result if wider == result.dtype else result.astype(wider, order="F")
        result[..., first : first + count] = slab.reshape((*shape[:-1], count), order="F")
    stream.read(1)  # past the end, where gzip's sum is checked
    return result


def _exactly(stream: IO[bytes], count: int) -> bytes:
    parts, missing = [], count
    while missing:
        part = stream.read(missing)
        if not part:
            raise ValueError(f"it ends {missing} bytes too early; it is cut off")
        parts.append(part)
        missing -= len(part)
    return b"".join(parts)


def to_labels(slab: np.ndarray) -> np.ndarray:
    """Labels as the smallest type that holds them.

    Raises:
        ValueError: numbers that are no labels.
    """
    if slab.dtype.kind == "f" and not (np.isfinite(slab).all() and (slab == np.rint(slab)).all()):
        odd = slab[~(slab == np.rint(slab))]
        raise ValueError(
            f"labels are whole numbers, and it holds {odd[0] if odd.size else np.inf:g}; give the label map, not "
            "probabilities or the scan itself"
        )
    low, high = slab.min(), slab.max()
    if low < 0 or high > _MOST_LABEL:
        raise ValueError(
            f"labels are from 0 to {_MOST_LABEL}, and it holds {low if low < 0 else high:g}; give the "
            "label map, not "
            "the scan itself (that is --ct)"
        )
    return slab.astype(np.uint8 if high < 256 else np.uint16)


def to_hounsfield(slope: float, intercept: float) -> Convert:
    """How the numbers of a file become Hounsfield units, whole numbers of 16 bits."""

    def convert(slab: np.ndarray) -> np.ndarray:
        values = slope * slab.astype(np.float32) + intercept
        return np.rint(np.clip(np.nan_to_num(values, nan=-1024.0), -32768, 32767)).astype(np.int16)

    return convert
