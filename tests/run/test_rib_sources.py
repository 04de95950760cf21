"""What the shares of the ribs leave open, against bones moved anew by those shares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from warp_trunk.case import Case
from warp_trunk.case.rib_shares import RANGES, RibShares
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.preparation.deformity import SpineCurve, correct, impose
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.run.paths import motions_of
from warp_trunk.run.sources import rib_share_sources

STRAIGHT = straight_trunk()[2]
SKIN, BONES, BEFORE = impose(*straight_trunk(), SpineCurve(cobb=40.0))
DEROTATED = SpineCurve(cobb=20.0, apical_rotation=1.0)
"""Screws turn it further than goes with the curve."""
CASE = Case("curved", SKIN, BONES, BEFORE, correct(STRAIGHT, DEROTATED, 0.0))
NODES = np.vstack([bone.vertices[::40] for bone in BONES.values()])
OWNER = np.concatenate([np.full(len(bone.vertices[::40]), i) for i, bone in enumerate(BONES.values())])
NONE = np.empty((0, 3), dtype=np.int32)
TRUNK = TrunkMesh(NODES, np.empty((0, 4), dtype=np.int32), NONE[:, 0], NONE, OWNER, tuple(BONES), NONE)
SOURCES = {source.name: source for source in rib_share_sources(CASE, TRUNK)}


@pytest.mark.parametrize("share", sorted(RANGES))
def test_a_source_is_half_of_what_its_share_does_over_its_range(share: str) -> None:
    mine = list(BONES).index("rib_right_08") == OWNER
    low, high = (
        motions_of(replace(CASE, rib_shares=replace(RibShares(), **{share: end})))["rib_right_08"].apply(
            NODES[mine]
        )
        for end in RANGES[share]
    )
    moved = SOURCES[f"ribs' share of {share}"].bones
    assert moved is not None
    np.testing.assert_allclose(moved[mine], (high - low) / 2.0, atol=1e-9)
    assert np.abs(moved[mine]).max() > 0.05


def test_vertebrae_and_pelvis_do_not_depend_on_the_shares() -> None:
    still = [i for i, name in enumerate(BONES) if not name.startswith(("rib", "sternum"))]
    for source in SOURCES.values():
        assert source.bones is not None
        assert np.abs(source.bones[np.isin(OWNER, still)]).max() < 1e-9
