"""The writer on all cores against meshio's own: the same bytes, but for meshio's comment and the bones' names."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

from support.meshes import block_with_bone
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.io.trunk_file import as_meshio, read_trunk, write_trunk

BLOCK = block_with_bone((12, 11, 10), holes=((1, 1, 1), (3, 1, 1)))  # arrays of several blocks
BARE = replace(BLOCK, bone_faces=BLOCK.tets[:3000, :3], bone_names=("L1", "rib läng"))
MANY = len(BARE.tets)
RNG = np.random.default_rng(2)


@pytest.mark.parametrize(
    "trunk",
    [
        BARE,
        replace(BARE, tissue=RNG.integers(3, size=MANY).astype(np.int8)),
        replace(BARE, tissue=np.column_stack([share := RNG.random(MANY), 1.0 - share])),
        replace(BARE, bone_faces=BLOCK.tets[:1, :3]),
    ],
    ids=["bare", "labels", "parts", "small"],
)
def test_meshio_writes_the_same(trunk: TrunkMesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    displacement = RNG.normal(size=trunk.nodes.shape)
    write_trunk(tmp_path / "fast.vtu", trunk, displacement)
    monkeypatch.setattr("warp_trunk.io.vtu_writing.LEVEL", -1)  # meshio's
    write_trunk(tmp_path / "own.vtu", trunk, displacement)
    meshio.write(tmp_path / "meshio.vtu", as_meshio(trunk, displacement), file_format="vtu")
    own = re.sub(rb"<FieldData>.*?</FieldData>", b"", (tmp_path / "own.vtu").read_bytes(), flags=re.DOTALL)
    theirs = re.sub(rb"<!--.*?-->\n", b"", (tmp_path / "meshio.vtu").read_bytes())
    assert own == theirs
    back, moved = read_trunk(tmp_path / "fast.vtu")
    np.testing.assert_array_equal(moved, displacement)
    assert back.bone_names == trunk.bone_names
    np.testing.assert_array_equal(back.tets, trunk.tets)
