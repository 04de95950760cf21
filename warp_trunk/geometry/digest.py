"""Digests of large inputs, by which two of them are compared without being kept."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .surface import Surface


def digest(*parts: np.ndarray | str | bytes) -> str:
    """A digest of arrays with their types and shapes, of texts and of bytes, in hexadecimal."""
    found = hashlib.blake2b(digest_size=20)
    for part in parts:
        if isinstance(part, np.ndarray):
            found.update(f"{part.dtype.str} {part.shape}".encode())
            found.update(np.ascontiguousarray(part).tobytes())
        else:
            found.update(part.encode() if isinstance(part, str) else part)
    return found.hexdigest()


def surface_digest(surface: Surface) -> str:
    """The digest of every vertex and face of a surface."""
    return digest(surface.vertices, surface.faces)
