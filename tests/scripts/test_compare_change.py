"""How a predicted change is judged by a published one, and how processes share work."""

import math
import operator
from dataclasses import replace

import compare_change
import numpy as np
import pytest
from compare_change import PLANNED, Change, Part, Row, lateral_deviation, scattered
from processes import in_processes

from support.known_spine import known_spine
from warp_trunk import SpineCurve
from warp_trunk.measures.measures import measure_spine
from warp_trunk.preparation.deformity.published_curves import Kind

PAIRS = np.array([[10.0, 4.0], [12.0, 5.0], [8.0, 3.0]])
"""Their mean change is -6.0."""


@pytest.mark.parametrize(("published", "within"), [(-6.0, True), (-7.9, True), (-8.1, False), (-3.9, False)])
def test_within_two_standard_errors(published: float, within: bool) -> None:
    part = Part("hump", "10 to 4", published, 1.0, PAIRS)
    assert part.within is within
    assert part.text() == f"hump 10.0 to 4.0 (-6.0; {published:+.3g} ± 1)"


def test_a_row_counts_what_is_judged() -> None:
    falls = Part("shoulders", "falls", math.nan, math.nan, PAIRS)
    assert falls.within
    assert not replace(falls, values=PAIRS[:, ::-1]).within
    near, off = Part("a", "", -6.0, 1.0, PAIRS), Part("b", "", 6.0, 1.0, PAIRS)
    assert Row("curve", "3", (near, replace(off, unjudged=PLANNED)), "").verdict == "within"
    assert Row("curve", "3", (near, off), "").verdict == "beside (1 of 2 within)"


def test_the_lumbar_curve_is_that_below_the_main_one() -> None:
    """Also where a lumbosacral one follows, and where the main one is not the largest."""
    spine = measure_spine(known_spine(to_left={"T1": -5.0, "T5": 30.0, "T11": -30.0, "L3": 15.0, "L5": 0.0}))
    assert [round(curve.angle) for curve in spine.cobb] == [35, 60, 45, 15]
    assert Change(spine, spine, "T8").lumbar.ends == "T11-L3"
    assert Change(spine, spine, "T1").of("cobb_deg", main=True) == pytest.approx([35.0, 35.0], abs=0.5)


def test_lateral_deviation_is_enlarged_by_its_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """A straight spine without error has none, and a bow of 10 degrees its sagitta; with it a straight one has the
    mean of the largest |a sin(u) + b sin(2 u)|, which quadrature of the angle of (a, b) gives."""
    angle, along = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False), np.linspace(0.0, np.pi, 17)
    waves = np.outer(np.cos(angle), np.sin(along)) + np.outer(np.sin(angle), np.sin(2.0 * along))
    expected = 6.4 * math.sqrt(math.pi / 2.0) * np.abs(waves).max(axis=1).mean()
    straight = measure_spine(known_spine(to_left={"T1": 0.0, "L5": 0.0}))
    bow = measure_spine(known_spine(to_left={"T1": -5.0, "L5": 5.0}))
    assert lateral_deviation(straight) == pytest.approx(expected, rel=0.05)
    monkeypatch.setattr(compare_change, "MIDLINE_ERROR", 0.0)
    assert lateral_deviation(straight) == pytest.approx(0.0, abs=1e-9)
    height = np.ptp(bow.spine.centroids[:, 2])
    assert lateral_deviation(bow) == pytest.approx(0.5 * height * math.tan(math.radians(2.5)), rel=0.02)


@pytest.mark.parametrize(("kind", "upper"), [("thoracic", 0.434), ("thoracolumbar", 0.630)])
def test_curves_scatter_around_the_mean_shape(kind: Kind, upper: float) -> None:
    """By 0.13 for the upper curve; what the group says stays."""
    curve = SpineCurve(kind=kind, cobb=50.0, lower_share=0.5)
    random = np.random.default_rng(1)
    drawn = [scattered(curve, random) for _ in range(500)]
    shares = np.array([each.upper_share for each in drawn], dtype=float)
    np.testing.assert_allclose([shares.mean(), shares.std()], [upper, 0.13], atol=0.012)
    assert {each.lower_share for each in drawn} == {0.5}


def test_processes_give_results_in_order() -> None:
    assert list(in_processes(operator.sub, [5, 9, 7], 4, 2)) == [1, 5, 3]
