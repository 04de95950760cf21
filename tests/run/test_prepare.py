"""From a case and options to mesh, bone path and model: every option reaches what it is about."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.small_trunk import small_case
from warp_trunk.engine.tissue import Tissue
from warp_trunk.run.options import RunOptions
from warp_trunk.run.patient import prepare

CASE, TRUNK = small_case()


def test_options_and_the_cases_tissue_reach_the_model() -> None:
    case = replace(CASE, tissue=Tissue(theta=7.0, epsilon=0.5, poisson_ratio=0.3))
    options = RunOptions(device="cpu", precision="float64", threads=1, gravity=9.81, energy="neo-hookean")
    model = prepare(case, options, TRUNK).model
    assert (model.device, model.precision, model.gravity) == ("cpu", "float64", 9.81)
    assert model.tissues == (case.tissue,)
    assert model.elements.unit == "mJ"


@pytest.mark.parametrize(
    ("options", "sags", "tissues"),
    [
        (RunOptions(device="cpu"), False, 1),
        (RunOptions(device="cpu", gravity=9.81), True, 1),
        (RunOptions(device="cpu", gravity=9.81, rest="scan"), False, 1),
        (RunOptions(device="cpu", rest="sag-free", layers="mesh"), False, 3),
    ],
)
def test_gravity_stands_at_rest_and_layers_are_told_apart(options: RunOptions, sags: bool, tissues: int) -> None:
    labels = np.arange(len(TRUNK.tets), dtype=np.int8) % 3
    labelled = replace(TRUNK, tissue=labels if options.layers == "mesh" else None)
    model = prepare(replace(CASE, tissue=Tissue(youngs_modulus=200.0)), options, labelled).model
    assert (model.scan is not None, len(model.tissues)) == (sags, tissues)


def test_bones_are_carried_by_the_spline_of_the_landmarks() -> None:
    moved = prepare(CASE, RunOptions(device="cpu", bones="spline"), TRUNK).bone_path.at(1.0)
    assert np.abs(moved).max() == pytest.approx(12.0, rel=0.5)  # as T8


def test_bones_move_rigidly_unless_asked_otherwise() -> None:
    path = prepare(CASE, RunOptions(device="cpu"), TRUNK).bone_path
    here = TRUNK.nodes[TRUNK.bone == 0]
    there = here + path.at(0.3)[TRUNK.bone == 0]
    before, after = (np.linalg.norm(p[:, None] - p[None], axis=2) for p in (here, there))
    np.testing.assert_allclose(after, before, atol=1e-9)
    assert np.abs(there - here).max() > 0.5
