"""A skin with its morph target, read back by trimesh and checked against Khronos' schema of glTF."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from trimesh.exchange import gltf

from support.report_results import write_small_result
from warp_trunk.cli import main
from warp_trunk.io.surface_files.morph import SECONDS, skin_glb
from warp_trunk.results import read_result


def scene_of(content):
    """The JSON of a GLB and its buffer."""
    length = struct.unpack_from("<I", content, 12)[0]
    return json.loads(content[20 : 20 + length]), content[28 + length :]


def values(scene, buffer, number):
    accessor = scene["accessors"][number]
    view = scene["bufferViews"][accessor["bufferView"]]
    data = np.frombuffer(buffer, "<f4", view["byteLength"] // 4, view["byteOffset"])
    return data.reshape(accessor["count"], -1)


def test_command_writes_both_skins_and_an_animation_that_leads_from_one_to_the_other(tmp_path, capsys):
    folder = write_small_result(tmp_path / "result", name="a & b")
    assert main(["export", str(folder), "--glb"]) == 0
    path, result = folder / "skin.glb", read_result(folder)
    assert str(path) in capsys.readouterr().out
    back = trimesh.load_mesh(path, process=False)
    in_lps = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]).T  # glTF: +y up, +z front, metres

    def lps(points):
        return 1000.0 * points @ in_lps.T

    np.testing.assert_allclose(lps(back.vertices), result.skin_before.vertices, atol=1e-3)
    np.testing.assert_array_equal(back.faces, result.skin_before.faces)
    assert back.volume > 0.0  # still outward
    scene, buffer = scene_of(path.read_bytes())
    target = scene["meshes"][0]["primitives"][0]["targets"][0]
    moved = back.vertices + values(scene, buffer, target["POSITION"])
    np.testing.assert_allclose(lps(moved), result.skin.vertices, atol=1e-3)
    sampler = scene["animations"][0]["samplers"][0]
    assert values(scene, buffer, sampler["input"]).ravel().tolist() == [0.0, SECONDS]
    assert values(scene, buffer, sampler["output"]).ravel().tolist() == [0.0, 1.0]


@pytest.mark.parametrize("coloured", [False, True])
def test_file_is_valid_with_and_without_colours(tmp_path, coloured):
    pytest.importorskip("jsonschema", reason="jsonschema is not installed (uv sync installs it)")
    result = read_result(write_small_result(tmp_path))
    before = result.skin_before
    if coloured:
        before = replace(
            before, colours=np.random.default_rng(1).integers(0, 256, before.vertices.shape, np.uint8)
        )
    content = skin_glb(before, result.skin, ("skin", "predicted"))
    scene, _ = scene_of(content)
    gltf.validate(scene)
    for accessor in scene["accessors"]:
        assert accessor["count"] > 0
    assert ("COLOR_0" in scene["meshes"][0]["primitives"][0]["attributes"]) == coloured
