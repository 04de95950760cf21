"""STL, OFF and GLB, read by trimesh from memory, so that it finds no other file.

What it would take for something else without a word is refused here first.
"""

from __future__ import annotations

import io
import re
import struct
import warnings
from typing import Any

import msgspec
import numpy as np

from warp_trunk.geometry.colours import from_linear, mean_colours

from .textures import corner_colours, material_of

_UINT16 = 5123
"""Type of colours that trimesh 5.2 reads wrongly."""
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


def read_glb(content: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Vertices, triangles and colours of all meshes of the scene, each moved by its node.

    Colours are 0 to 255, NaN where there are none; None without any.
    """
    scene = _scene(content)
    check_scene(scene, len(content))
    of_vertices = {
        part["attributes"]["COLOR_0"]
        for mesh in scene.get("meshes", [])
        for part in mesh["primitives"]
        if "COLOR_0" in part["attributes"]
    }
    if not of_vertices and not scene.get("images"):
        return *_load(content, "glb"), None
    import trimesh  # heavy

    whole: Any = trimesh.load_scene(io.BytesIO(content), file_type="glb", process=False)
    placed = [whole.graph[node] for node in whole.graph.nodes_geometry]
    parts = [whole.geometry[name] for _, name in placed]
    vertices = [trimesh.transform_points(whole.geometry[name].vertices, matrix) for matrix, name in placed]
    usable = all(scene["accessors"][number]["componentType"] != _UINT16 for number in of_vertices)
    linear = "trimesh" not in scene.get("asset", {}).get("generator", "")  # which writes them as they are
    colours, faces, start = [], [], 0
    for part in parts:
        found, visual = np.full((len(part.vertices), 3), np.nan), part.visual
        if visual.kind == "texture":
            uv = np.zeros((len(found), 2)) if visual.uv is None else visual.uv
            seen = corner_colours(uv[part.faces], material_of(visual)).reshape(-1, 3)
            found = mean_colours(seen, part.faces.reshape(-1), len(found))
            if (own := visual.vertex_attributes.get("color")) is not None:
                own = own[:, :3] / (np.iinfo(own.dtype).max if own.dtype.kind == "u" else 1.0)
                found = found * (from_linear(own) if linear else own)
        elif visual.kind == "vertex" and usable:
            found = np.asarray(visual.vertex_colors, dtype=np.float64)[:, :3]
            found = from_linear(found / 255.0) * 255.0 if linear else found
        colours.append(found)
        faces.append(part.faces + start)
        start += len(part.vertices)
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(colours)


def _scene(content: bytes) -> dict[str, Any]:
    if content[:4] != b"glTF" or len(content) < 20:
        raise ValueError("it does not begin as a GLB")
    length = struct.unpack_from("<I", content, 12)[0]
    return msgspec.json.decode(content[20 : 20 + length], type=dict[str, Any])


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
