"""Films of side bending: how much of a curve bends out, what an unfused one does, and what no film showed."""

import numpy as np
import pytest

from support.known_spine import known_spine
from warp_trunk.bone_motion.plan import CurvePlan, Plan, plan_surgery
from warp_trunk.case import Case
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface

STANDING = {"T1": -5.0, "T5": 30.0, "T12": -30.0, "L4": 10.0, "L5": 10.0}
"""A thoracic curve of 60 degrees to the right over a lumbar one of 40 to the left."""
RIGHT = {"T1": -30.0, "T5": -5.0, "T12": -35.0, "L4": 13.0, "L5": 13.0}
LEFT = {"T1": 45.0, "T5": 50.0, "T12": -4.0, "L4": 6.0, "L5": 6.0}
"""Bent to the right the thoracic curve is 30 degrees, to the left the lumbar one is 10."""


def case(left: dict[str, float] | None = LEFT, right: dict[str, float] | None = RIGHT) -> Case:
    return Case(
        "bends",
        Surface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32)),
        {},
        known_spine(to_left=STANDING),
        bending_left=None if left is None else known_spine(to_left=left),
        bending_right=None if right is None else known_spine(to_left=right),
    )


PLAN = Plan(uiv="T4", liv="T12", curves=(CurvePlan(apex="T8", correction=0.8),))


def test_share_that_bends_out() -> None:
    flexibility = {curve.before.upper: curve.flexibility for curve in plan_surgery(case(), PLAN).curves}
    assert flexibility["T5"] == pytest.approx(0.5, abs=1e-6)
    assert flexibility["T12"] == pytest.approx(0.75, abs=1e-6)


def test_unfused_curve_corrects_by_what_bent_out() -> None:
    """Unless the plan says another share."""
    assert plan_surgery(case(), PLAN).curves[-1].cobb_after == pytest.approx(10.0, abs=0.1)
    said = Plan(uiv="T4", liv="T12", spontaneous=0.2, curves=PLAN.curves)
    assert plan_surgery(case(), said).curves[-1].cobb_after == pytest.approx(32.0, abs=0.1)


def test_more_than_a_film_showed_is_told() -> None:
    """60 degrees over T5 to T12 bent out to 30: 4.3 of 8.6 degrees a segment; a correction of 48 asks for 6.9."""
    (text,) = plan_surgery(case(), PLAN).warnings
    assert "bends further than the films of side bending showed" in text
    assert "T8-T9 by 2.6" in text
    gentle = Plan(uiv="T4", liv="T12", curves=(CurvePlan(apex="T8", correction=0.4),))
    assert plan_surgery(case(), gentle).warnings == ()


def test_films_that_are_exchanged() -> None:
    with pytest.raises(InputError, match="exchange the two files"):
        plan_surgery(case(RIGHT, LEFT), PLAN)
