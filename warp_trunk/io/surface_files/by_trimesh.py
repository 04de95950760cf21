"""STL, OFF and GLB, read by trimesh from memory, so that it finds no other file.

What it would take for something else without a word is refused here first.
"""

from __future__ import annotations

import io
import logging
import re
import struct
import warnings
from typing import Any

import msgspec
import numpy as np

from warp_trunk.geometry.colours import from_linear, mean_colours

from ..file_access import FormatError
from .textures import corner_colours, material_of

_log = logging.getLogger("warp_trunk")
_UINT16 = 5123
"""Type of colours that trimesh 5.2 reads wrongly."""
_TRIANGLES, _UNREAD_MODES = 4, (2, 6)
"""Kinds of primitives: triangles; loops of lines and fans of triangles, which trimesh 5.2 passes over."""
_OF_COLOURS = ("KHR_materials", "KHR_texture", "EXT_texture", "MSFT_texture", "KHR_lights", "KHR_xmp")
"""How extensions begin that do not change places."""
_MOST_NODES = 1000
"""Each node repeats the triangles of its mesh, so that a small file could stand for any number of them."""


def read_stl(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles; points are repeated for each triangle."""
    text = content.lower() if _is_ascii_stl(content) else b""
    if text and b"facet" not in text:
        said = struct.unpack_from("<I", content, 80)[0] if len(content) >= 84 else 0
        raise FormatError(f"its header says {said} triangles, its {len(content)} bytes hold another number")
    if text and text.count(b"endfacet") * 3 != len(re.findall(rb"\bvertex\b", text)):
        raise FormatError("facets without three vertices; the file is cut off or damaged")
    if text and b"endsolid" not in text[text.rfind(b"endfacet") :]:
        raise FormatError("there is no 'endsolid'; the file is cut off")
    if text and re.search(rb"\d,\d", text):  # decimal commas
        content = content.replace(b",", b".")
    return _load(content, "stl")


def _is_ascii_stl(content: bytes) -> bool:
    """The count of a binary file fits its length, also where its title begins with 'solid'."""
    return len(content) < 84 or 84 + 50 * struct.unpack_from("<I", content, 80)[0] != len(content)


def read_off(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles."""
    if any(b"_" in line.split(b"#")[0] for line in content.splitlines()):
        raise FormatError("numbers have no underscores")
    return _load(content, "off")


def read_glb(content: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Vertices, triangles and colours of all meshes of the scene, each moved by its node.

    Colours are 0 to 255, NaN where there are none; None without any.
    """
    scene = _scene(content)
    check_scene(scene, len(content))
    pictures = _embedded(scene)
    import trimesh  # heavy

    whole: Any = trimesh.load_scene(
        io.BytesIO(content), file_type="glb", process=False, skip_materials=not pictures
    )
    moves = _texture_moves(scene, list(whole.geometry))
    vertices, faces, colours, start = [], [], [], 0
    for node in whole.graph.nodes_geometry:
        matrix, name = whole.graph[node]
        part = whole.geometry[name]
        if not hasattr(part, "faces"):  # lines and points
            continue
        vertices.append(trimesh.transform_points(part.vertices, matrix))
        mirrored = np.linalg.det(matrix[:3, :3]) < 0.0
        faces.append((part.faces[:, ::-1] if mirrored else part.faces) + start)
        colours.append(_colours(part, scene, moves.get(name)))
        start += len(part.vertices)
    if not vertices:
        raise FormatError("it holds no triangles")
    numbers = np.concatenate(colours)
    return np.concatenate(vertices), np.concatenate(faces), numbers if np.isfinite(numbers).any() else None


def _texture_moves(scene: dict[str, Any], names: list[str]) -> dict[str, np.ndarray]:
    """How places in pictures move by the extension KHR_texture_transform, for each mesh that has it, shape (2, 3).

    The extension scales, then turns, then shifts places that count from the upper left corner.
    """
    parts = _primitives(scene)
    if len(parts) != len(names):  # trimesh names the primitives in their order
        return {}
    moves = {}
    for name, part in zip(names, parts, strict=True):
        material = scene.get("materials", [])[part["material"]] if "material" in part else {}
        picture = material.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
        move = picture.get("extensions", {}).get("KHR_texture_transform")
        if move is None:
            continue
        c, s = np.cos(move.get("rotation", 0.0)), np.sin(move.get("rotation", 0.0))
        turn = np.array([[c, s], [-s, c]]) * move.get("scale", [1.0, 1.0])
        moves[name] = np.column_stack([turn, move.get("offset", [0.0, 0.0])])
    return moves


def _colours(part: Any, scene: dict[str, Any], move: np.ndarray | None) -> np.ndarray:
    """The colours of the vertices of a mesh, 0 to 255, NaN where there are none, shape (vertices, 3).

    Args:
        part: as trimesh read it.
        scene: the file's own.
        move: of the places in its picture (`_texture_moves`).
    """
    colours, visual = np.full((len(part.vertices), 3), np.nan), part.visual
    linear = "trimesh" not in scene.get("asset", {}).get("generator", "")  # which writes them as they are
    if visual.kind == "texture" and getattr(visual.material, "baseColorTexture", None) is not None:
        uv = np.zeros((len(colours), 2)) if visual.uv is None else np.asarray(visual.uv)
        if move is not None:
            down = uv * [1.0, -1.0] + [0.0, 1.0]  # trimesh counts from the lower left corner
            uv = (down @ move[:, :2].T + move[:, 2]) * [1.0, -1.0] + [0.0, 1.0]
        seen = corner_colours(uv[part.faces], material_of(visual)).reshape(-1, 3)
        colours = mean_colours(seen, part.faces.reshape(-1), len(colours))
        if (own := visual.vertex_attributes.get("color")) is not None:
            own = own[:, :3] / (np.iinfo(own.dtype).max if own.dtype.kind == "u" else 1.0)
            colours = colours * (from_linear(own) if linear else own)
    elif visual.kind == "vertex" and _readable_colours(scene):
        colours = np.asarray(visual.vertex_colors, dtype=np.float64)[:, :3]
        colours = from_linear(colours / 255.0) * 255.0 if linear else colours
    return colours


def _primitives(scene: dict[str, Any]) -> list[dict[str, Any]]:
    return [part for mesh in scene.get("meshes", []) for part in mesh["primitives"]]


def _readable_colours(scene: dict[str, Any]) -> bool:
    """Whether trimesh reads the colours of all vertices."""
    numbers = {part["attributes"].get("COLOR_0") for part in _primitives(scene)} - {None}
    return all(scene["accessors"][number]["componentType"] != _UINT16 for number in numbers)


def _embedded(scene: dict[str, Any]) -> bool:
    """Whether there are pictures, all in the file; a warning for those that are not opened."""
    images = scene.get("images", [])
    if any("uri" in image and not str(image["uri"]).startswith("data:") for image in images):
        _log.warning("a GLB keeps pictures in other files, which are not opened; its colours are left out")
        return False
    return bool(images)


def _scene(content: bytes) -> dict[str, Any]:
    if content[:4] != b"glTF" or len(content) < 20:
        raise FormatError("it does not begin as a GLB")
    length = struct.unpack_from("<I", content, 12)[0]
    try:
        return msgspec.json.decode(content[20 : 20 + length], type=dict[str, Any])
    except msgspec.DecodeError as error:
        raise FormatError("its table of contents is damaged") from error


def check_scene(scene: dict[str, Any], size: int) -> None:
    """FormatError for what trimesh would fill with zeros, look for elsewhere, pass over, or never end with."""
    needed = [name for name in scene.get("extensionsRequired", []) if not str(name).startswith(_OF_COLOURS)]
    if needed:
        raise FormatError(f"it needs {needed[0]}; save it without compression")
    if any("uri" in part and not str(part["uri"]).startswith("data:") for part in scene.get("buffers", [])):
        raise FormatError("it keeps parts in other files, which are not opened; save all in one .glb")
    accessors, places = scene.get("accessors", []), set()
    for part in _primitives(scene):
        if part.get("mode", _TRIANGLES) in _UNREAD_MODES:
            raise FormatError("it has fans or loops, which are not read; save it with triangles")
        places |= {part["attributes"]["POSITION"], *([part["indices"]] if "indices" in part else [])}
    for number, accessor in enumerate(accessors):
        empty = number in places and ("bufferView" not in accessor or "sparse" in accessor)
        if empty or not 0 <= accessor["count"] <= size:
            raise FormatError("it has numbers without data, or more than the file can hold")
    if sum("mesh" in node for node in scene.get("nodes", [])) > _MOST_NODES:
        raise FormatError(f"more than {_MOST_NODES} nodes hold a mesh; join them")
    children = [child for node in scene.get("nodes", []) for child in node.get("children", [])]
    if len(set(children)) < len(children):
        raise FormatError("a node of its scene hangs under two others")


def _load(content: bytes, kind: str) -> tuple[np.ndarray, np.ndarray]:
    import trimesh  # heavy

    with warnings.catch_warnings():
        # numpy only warns where it ends reading numbers at something that is none
        warnings.simplefilter("error", DeprecationWarning)
        mesh = trimesh.load_mesh(io.BytesIO(content), file_type=kind, process=False, skip_materials=True)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)
