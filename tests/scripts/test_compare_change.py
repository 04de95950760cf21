"""How a predicted change is judged by a published one, and how processes share work."""

import math
import operator
from dataclasses import replace

import numpy as np
import pytest
from compare_change import PLANNED, Change, Part, Row, correlation
from processes import in_processes

from support.known_spine import known_spine
from warp_trunk.measures.measures import measure_spine

PAIRS = np.array([[10.0, 4.0], [12.0, 5.0], [8.0, 3.0]])
"""Their mean change is -6.0."""


@pytest.mark.parametrize(("published", "within"), [(-6.0, True), (-7.9, True), (-8.1, False), (-3.9, False)])
def test_within_two_standard_errors(published: float, within: bool) -> None:
    part = Part("hump", "10 to 4", published, 1.0, PAIRS)
    assert part.within is within
    assert part.text() == f"hump 10.0 to 4.0 (-6.0; {published:+.3g} ± 1)"


def test_a_number_that_is_said_to_fall() -> None:
    falls = Part("shoulders", "falls", math.nan, math.nan, PAIRS)
    assert falls.within
    assert not replace(falls, values=PAIRS[:, ::-1]).within


def test_a_row_counts_what_is_judged() -> None:
    near, off = Part("a", "", -6.0, 1.0, PAIRS), Part("b", "", 6.0, 1.0, PAIRS)
    assert Row("curve", "3", (near, replace(off, unjudged=PLANNED)), "").verdict == "within"
    assert Row("curve", "3", (near, off), "").verdict == "beside (1 of 2 within)"


def test_correlation_leaves_missing_numbers_out() -> None:
    pairs = np.array([[0.0, 5.0], [1.0, 3.0], [2.0, 1.0], [math.nan, 9.0]])
    np.testing.assert_allclose(correlation(pairs), [-1.0])


def test_the_lumbar_curve_is_that_below_the_largest() -> None:
    """Also where a lumbosacral one follows."""
    spine = measure_spine(known_spine(to_left={"T1": -5.0, "T5": 30.0, "T11": -30.0, "L3": 15.0, "L5": 0.0}))
    assert [round(curve.angle) for curve in spine.cobb] == [35, 60, 45, 15]
    assert Change(spine, spine).lumbar.ends == "T11-L3"


@pytest.mark.parametrize("jobs", [1, 2])
def test_processes_give_results_in_order(jobs: int) -> None:
    assert list(in_processes(operator.sub, [5, 9, 7], 4, jobs)) == [1, 5, 3]
