"""Defaults of options."""

from __future__ import annotations

from typing import Literal

import pytest

from warp_trunk.engine.energies.by_name import EnergyName, WeightsName
from warp_trunk.run.options import SKIN_RIGIDITY, RunOptions, parameters

Bones = Literal["spline", "follow"]


@pytest.mark.parametrize(
    ("bones", "weights", "energy", "taken"),
    [
        ("spline", "count", None, "itmsm"),
        ("follow", "count", None, "neo-hookean"),
        ("follow", "volume", None, "itmsm"),
    ],
)
def test_the_energy_goes_by_how_bones_move(
    bones: Bones, weights: WeightsName, energy: EnergyName | None, taken: EnergyName
) -> None:
    options = RunOptions(bones=bones, weights=weights, energy=energy)
    assert options.energy_of_tissue == taken
    assert parameters(options)["energy"] == taken


@pytest.mark.parametrize(
    ("bones", "given", "taken"),
    [("spline", None, 0.0), ("follow", None, SKIN_RIGIDITY), ("follow", 0.0, 0.0), ("spline", 0.2, 0.2)],
)
def test_the_skin_is_stiff_where_ribs_follow(bones: Bones, given: float | None, taken: float) -> None:
    options = RunOptions(bones=bones, skin_rigidity=given)
    assert options.rigidity_of_skin == taken
    assert parameters(options)["skin_rigidity"] == taken


def test_the_rigidity_is_that_of_skin_2_mm_thick_by_torsion() -> None:
    """E h^3 / (12 (1 - nu^2)) of 0.42 N/mm^2, 2 mm, and a volume that does not change, to a tenth."""
    assert pytest.approx(0.42 * 2.0**3 / (12.0 * 0.75), rel=0.1) == SKIN_RIGIDITY
