"""STL, OFF and GLB, read by trimesh from memory, so that it finds no other file.

What it would take for something else without a word is refused here first.
"""

from __future__ import annotations

import io
import json
import re
import struct
import warnings
from typing import Any

import numpy as np

_MOST_NODES = 1000
"""Each node repeats the triangles of its mesh, so that a small file could stand for any number of them."""


def read_stl(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles; points are repeated for each triangle."""
    text = content.lower() if _is_ascii_stl(content) else b""
    if text and b"facet" not in text:
        said = struct.unpack_from("<I", content, 80)[0] if len(content) >= 84 else 0
        raise ValueError(f"its header says {said} triangles, its {len(content)} bytes hold another number")
    if text and text.count(b"endfacet") * 3 != len(re.findall(rb"\bvertex\b", text)):
        raise ValueError("facets without three vertices; the file is cut off or damaged")
    if text and b"endsolid" not in text[text.rfind(b"endfacet") :]:
        raise ValueError("there is no 'endsolid'; the file is cut off")
    return _load(content, "stl")


def _is_ascii_stl(content: bytes) -> bool:
    """The count of a binary file fits its length, also where its title begins with 'solid'."""
    return len(content) < 84 or 84 + 50 * struct.unpack_from("<I", content, 80)[0] != len(content)


def read_off(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles."""
    if any(b"_" in line.split(b"#")[0] for line in content.splitlines()):
        raise ValueError("numbers have no underscores")
    return _load(content, "off")


def read_glb(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of all meshes of the scene, each moved by its node."""
    check_scene(_scene(content), len(content))
    return _load(content, "glb")


def _scene(content: bytes) -> dict[str, Any]:
    if content[:4] != b"glTF" or len(content) < 20:
        raise ValueError("it does not begin as a GLB")
    length = struct.unpack_from("<I", content, 12)[0]
    scene = json.loads(content[20 : 20 + length])
    if not isinstance(scene, dict):
        raise ValueError("it holds no scene")
    return scene


def check_scene(scene: dict[str, Any], size: int) -> None:
    """ValueError for what trimesh would fill with zeros, look for elsewhere, or never end with."""
    if scene.get("extensionsRequired"):
        raise ValueError(f"it needs {scene['extensionsRequired'][0]}; save it without compression")
    if any("uri" in part for part in (*scene.get("buffers", []), *scene.get("images", []))):
        raise ValueError("it keeps parts in other files, which are not opened; save all in one .glb")
    for accessor in scene.get("accessors", []):
        if "bufferView" not in accessor or "sparse" in accessor or not 0 <= accessor["count"] <= size:
            raise ValueError("it has numbers without data, or more than the file can hold")
    if sum("mesh" in node for node in scene.get("nodes", [])) > _MOST_NODES:
        raise ValueError(f"more than {_MOST_NODES} nodes hold a mesh; join them")
    children = [child for node in scene.get("nodes", []) for child in node.get("children", [])]
    if len(set(children)) < len(children):
        raise ValueError("a node of its scene hangs under two others")


def _load(content: bytes, kind: str) -> tuple[np.ndarray, np.ndarray]:
    import trimesh  # heavy

    with warnings.catch_warnings():
        # numpy only warns where it ends reading numbers at something that is none
        warnings.simplefilter("error", DeprecationWarning)
        mesh = trimesh.load_mesh(io.BytesIO(content), file_type=kind, process=False, skip_materials=True)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)
