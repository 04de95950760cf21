"""A prediction and its observers."""

from __future__ import annotations

import numpy as np

from support.small_trunk import boned_case
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.measures import measure
from warp_trunk.run.clock import Clock
from warp_trunk.run.options import RunOptions
from warp_trunk.run.prediction import prepare


def test_observers_see_every_increment_and_the_skin_is_that_of_the_last() -> None:
    case, trunk = boned_case()
    options = RunOptions(bones="spline", device="cpu", simulation=SimulationOptions(increments=3))
    prediction, seen = prepare(case, options, trunk), list[float]()
    prediction.relax(lambda increment: seen.append(increment.load_factor), lambda _: seen.append(0.0))
    assert seen == [1 / 3, 0.0, 2 / 3, 0.0, 1.0, 0.0]
    assert [one.number for one in prediction.increments] == [1, 2, 3]
    assert prediction.converged
    moved = (trunk.nodes + prediction.last.displacement)[trunk.skin_nodes]
    np.testing.assert_allclose(prediction.skin.vertices, moved, atol=1e-12)
    found = prediction.measures_at(prediction.last)
    assert found.bsr == measure(prediction.skin, case.planned_landmarks, case.skin).bsr
    assert prediction.relax().increments[-1].number == 3  # again, from before surgery


def test_a_clock_adds_stages_of_one_name() -> None:
    clock = Clock()
    clock.add("relax", 1.5)
    clock.add("relax", 0.5)
    with clock.stage("mesh"):
        pass
    assert clock.seconds["relax"] == 2.0
    assert clock.seconds.keys() == {"relax", "mesh"}
