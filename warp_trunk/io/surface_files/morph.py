"""A skin that changes into another one: glTF with a morph target and its animation, written by trimesh."""

from __future__ import annotations

from typing import Any

import numpy as np

from warp_trunk.geometry.colours import to_linear
from warp_trunk.geometry.surface import Surface, vertex_normals

SECONDS = 3.0
"""Duration of the animation [s]."""
_AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From +x left, +y back, +z up to +x left, +y up, +z front, as glTF has it."""
_CLAY = [0.89, 0.80, 0.74, 1.0]
_FLOAT, _WEIGHTS = 5126, "weights"


def skin_glb(before: Surface, after: Surface | None, names: tuple[str, str], *, plain: bool = False) -> bytes:
    """A GLB file in metres: a surface, its change into another one as a morph target, and that as an animation.

    Args:
        before: at weight 0 [mm], LPS; its colours are written where it has some.
        after: at weight 1, same triangles [mm]; without one the surface stays.
        names: of the mesh and of the morph target.
        plain: leave the colours out.
    """
    import trimesh
    from trimesh.exchange.gltf import export_glb
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    ends = [surface for surface in (before, after) if surface is not None]
    places = [surface.vertices / 1000.0 @ _AXES.T for surface in ends]
    normals = [vertex_normals(surface) @ _AXES.T for surface in ends]
    mesh = trimesh.Trimesh(places[0], before.faces, vertex_normals=normals[0], process=False)
    colours = None if plain else before.colours
    base = _CLAY if colours is None else [1.0, 1.0, 1.0, 1.0]
    material = PBRMaterial(name="skin", baseColorFactor=base, metallicFactor=0.0, roughnessFactor=0.8)
    mesh.visual = TextureVisuals(material=material)

    def completed(buffers: dict[str, bytes], tree: dict[str, Any]) -> None:
        def add(name: str, data: np.ndarray, kind: str) -> int:
            data = np.ascontiguousarray(data, dtype="<f4").reshape(len(data), -1)
            ends = {"min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist()}
            buffers[name] = data.tobytes()
            tree["accessors"][name] = {
                "bufferView": len(buffers) - 1, "componentType": _FLOAT, "count": len(data), "type": kind, **ends,
            }  # fmt: skip
            return len(tree["accessors"]) - 1

        shape = tree["meshes"][0]
        if colours is not None:
            shape["primitives"][0]["attributes"]["COLOR_0"] = add("colours", to_linear(colours / 255.0), "VEC3")
            tree["asset"]["generator"] = "warp_trunk"
        if after is None:
            return
        shape["primitives"][0]["targets"] = [
            {
                "POSITION": add("target", places[1].astype("f4") - places[0].astype("f4"), "VEC3"),
                "NORMAL": add("target normals", normals[1] - normals[0], "VEC3"),
            }
        ]
        shape |= {_WEIGHTS: [0.0], "extras": {"targetNames": [names[1]]}}
        node = next(number for number, item in enumerate(tree["nodes"]) if "mesh" in item)
        times = np.array([0.0, 1.0])
        sampler = {"input": add("times", SECONDS * times, "SCALAR"), "output": add(_WEIGHTS, times, "SCALAR")}
        channel = {"sampler": 0, "target": {"node": node, "path": _WEIGHTS}}
        tree["animations"] = [{"name": names[1], "samplers": [sampler], "channels": [channel]}]

    scene = trimesh.Scene({names[0]: mesh})
    return export_glb(scene, include_normals=True, buffer_postprocessor=completed)
