"""What is remembered of a trunk at rest: it changes no bit, and what cannot be this trunk's is found again."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from support.meshes import block_with_bone, rotate
from support.threads import split_launches
from warp_trunk.bone_motion.bone_path import BonePath
from warp_trunk.engine.build import build_model
from warp_trunk.engine.energies.by_name import EnergyName
from warp_trunk.engine.memo import Memo
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions, simulate
from warp_trunk.engine.trunk_mesh import TrunkMesh

TRUNK = block_with_bone((6, 5, 4), holes=((1, 1, 1), (3, 1, 1)))
PARTS = ["numbering.order", "held.loose", "features.edge", "features.face", "pattern.row_start", "pattern.columns"]
PARTS += ["pattern.place", "grids.coarsest", "grids.node_distance", "matrices.inverse", "matrices.diagonal_0"]


def end(memo: Memo | None, trunk: TrunkMesh = TRUNK, **options: Any) -> bytes:
    """Where a simulation ends, every bit."""
    model = build_model(
        trunk, device=split_launches(), memo=memo, **{"energy": "itmsm", "skin_rigidity": 0.0, **options}
    )
    path = BonePath(0.4 * (rotate(trunk.nodes, 12.0, (0.3, 1.0, 0.2)) - trunk.nodes))
    how = SimulationOptions(increments=2, relax=RelaxOptions(tolerance=1e-3))
    return list(simulate(model, path, how))[-1].from_rest.tobytes()


@pytest.fixture(scope="module")
def found() -> dict[str, np.ndarray]:
    memo = Memo()
    end(memo)
    assert memo.is_new
    return memo.asked


def test_all_that_takes_long_is_remembered(found: dict[str, np.ndarray]) -> None:
    assert sorted(found) == sorted(PARTS)


@pytest.mark.parametrize("energy", ["itmsm", "neo-hookean"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_what_is_remembered_changes_no_bit(energy: EnergyName, precision: str) -> None:
    first = Memo()
    alone = end(None, energy=energy, precision=precision)
    assert end(first, energy=energy, precision=precision) == alone
    again = Memo(first.asked)
    assert end(again, energy=energy, precision=precision) == alone
    assert not again.is_new


@pytest.mark.parametrize(
    ("name", "spoil"),
    [
        ("numbering.order", lambda order: order[::-1]),
        ("numbering.order", lambda order: np.zeros_like(order)),
        ("held.loose", lambda loose: loose + 3),
        ("features.edge", lambda count: count[1:]),
        ("features.face", lambda count: 0 * count),
        ("pattern.row_start", lambda start: start + 1),
        ("pattern.row_start", lambda start: start[:-1]),
        ("pattern.columns", lambda column: column + 1),
        ("pattern.columns", lambda column: -column),
        ("pattern.columns", lambda column: column.astype(float)),
        ("pattern.place", lambda place: place + 40),
        ("pattern.place", lambda place: place[:, :4]),
        ("grids.coarsest", lambda spacing: 100.0 * spacing),
        ("grids.node_distance", lambda distance: 1e-6 * distance),
        ("grids.node_distance", lambda distance: np.full(3, distance)),
        ("matrices.inverse", lambda inverse: inverse.astype(np.float64)),
        ("matrices.inverse", lambda inverse: inverse[3:, 3:]),
        ("matrices.inverse", lambda inverse: np.full_like(inverse, np.nan)),
        ("matrices.diagonal_0", lambda diagonal: diagonal[1:]),
        ("matrices.diagonal_0", lambda diagonal: diagonal.astype(np.float64)),
        ("matrices.diagonal_0", lambda diagonal: np.full_like(diagonal, np.inf)),
    ],
)
def test_what_cannot_be_of_this_trunk_is_found_again(
    found: dict[str, np.ndarray], name: str, spoil: Callable[[np.ndarray], np.ndarray]
) -> None:
    memo = Memo({**found, name: spoil(found[name])})
    assert end(memo) == end(None)
    assert memo.is_new
    np.testing.assert_array_equal(memo.asked[name], found[name])


@pytest.mark.parametrize("name", PARTS)
def test_what_is_missing_is_found(found: dict[str, np.ndarray], name: str) -> None:
    memo = Memo({key: values for key, values in found.items() if key != name})
    assert end(memo) == end(None)
    assert memo.is_new
    assert sorted(memo.asked) == sorted(PARTS)
