"""Ways to break a file of a good case."""

from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import numpy as np

from warp_trunk.geometry.surface import Surface
from warp_trunk.io.surface_files import read_surface, surface_writer, write_surface

Break = Callable[[Path], object]
"""Spoils a case folder."""


def shape(name: str, change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]) -> Break:
    """Changes vertices and triangles of a surface file."""

    def spoil(folder: Path) -> None:
        surface = read_surface(folder / name)
        vertices, faces = change(surface.vertices.copy(), surface.faces.copy())
        with patch.object(surface_writer, "check_surface"):  # which refuses what is broken
            write_surface(folder / name, Surface(vertices, faces))

    return spoil


def text(name: str, change: Callable[[str], str]) -> Break:
    """Changes the text of a file."""
    return lambda folder: (folder / name).write_text(change((folder / name).read_text("utf-8")), "utf-8")


def content(name: str, change: Callable[[bytes], bytes]) -> Break:
    """Changes the bytes of a file, which need not be there before."""

    def spoil(folder: Path) -> None:
        path = folder / name
        path.write_bytes(change(path.read_bytes() if path.exists() else b""))

    return spoil


def instead(name: str, other: str, data: bytes = b"") -> Break:
    """Another file in place of one."""

    def spoil(folder: Path) -> None:
        (folder / name).unlink()
        (folder / other).write_bytes(data)

    return spoil


def header(line: str) -> Break:
    """A line at the top of case.toml, in place of the one with the same key."""
    key = line.split("=")[0].strip()

    def change(old: str) -> str:
        return "\n".join([line, *(row for row in old.split("\n") if row.split("=")[0].strip() != key)])

    return text("case.toml", change)


def set_point(when: str, name: str, coordinates: str) -> Break:
    """Other coordinates of a landmark."""

    def change(old: str) -> str:
        return "\n".join(f"{name},{coordinates}" if row.startswith(f"{name},") else row for row in old.split("\n"))

    return text(f"landmarks_{when}.csv", change)


def ply(vertices: int, faces: int, kind: str = "binary_little_endian", data: bytes = b"") -> bytes:
    """A PLY whose header says more than it holds."""
    return (
        f"ply\nformat {kind} 1.0\nelement vertex {vertices}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode() + data
