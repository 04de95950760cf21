"""The effect of the shares of the ribs, against bones moved again by those shares."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from support.asserting import there
from warp_trunk.case import Case
from warp_trunk.case.rib_coupling import RANGES, RibCoupling
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.deformity import SpineCurve, correct, impose
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.run.patient import motions_of
from warp_trunk.run.sources import ErrorSource, rib_share_sources

DEROTATED = SpineCurve(cobb=20.0, apical_rotation=1.0)
"""Screws turn it further than goes with the curve."""
NONE = np.empty((0, 3), dtype=np.int32)


@cache
def curved() -> tuple[Case, TrunkMesh]:
    """A case with few nodes on its bones, and no tissue."""
    skin, straight, landmarks = straight_trunk()
    skin, bones, before = impose(skin, straight, landmarks, SpineCurve(cobb=40.0))
    return Case("curved", skin, bones, before, correct(landmarks, DEROTATED, 0.0)), few_nodes(bones)


def few_nodes(bones: Mapping[str, Surface]) -> TrunkMesh:
    nodes = [bone.vertices[::40] for bone in bones.values()]
    owner = np.repeat(np.arange(len(nodes)), [len(own) for own in nodes])
    tets = np.empty((0, 4), dtype=np.int32)
    return TrunkMesh(np.vstack(nodes), tets, NONE[:, 0], NONE, owner, tuple(bones), NONE)


@cache
def sources() -> dict[str, ErrorSource]:
    return {source.name: source for source in rib_share_sources(*curved())}


@pytest.mark.parametrize("share", sorted(RANGES.keys() - {"scapula"}))
def test_a_source_is_half_of_what_its_share_does_over_its_range(share: str) -> None:
    case, trunk = curved()
    rib = "rib_right_02" if share == "upper" else "rib_right_08"
    mine = trunk.bone == trunk.bone_names.index(rib)
    low, high = (
        motions_of(replace(case, rib_coupling=replace(RibCoupling(), **{share: end})))[rib].apply(
            trunk.nodes[mine]
        )
        for end in RANGES[share]
    )
    moved = there(sources()[f"ribs: {share.replace('_', ' ')}"].bones)
    np.testing.assert_allclose(moved[mine], (high - low) / 2.0, atol=1e-9)
    assert np.abs(moved[mine]).max() > 0.05


def test_vertebrae_and_pelvis_do_not_depend_on_the_shares() -> None:
    _, trunk = curved()
    still = [i for i, name in enumerate(trunk.bone_names) if not name.startswith(("rib", "sternum"))]
    for source in sources().values():
        assert np.abs(there(source.bones)[np.isin(trunk.bone, still)]).max() < 1e-9
