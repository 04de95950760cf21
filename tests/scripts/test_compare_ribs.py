"""The tables of ways to move ribs: what is told of a row, worked by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ribs.rows import LEVELS, Distance, Row, Shoulders, Smoothness, distance, smoothness
from ribs.tables import ABOVE, BELOW, by_bar, by_patient, by_share, by_truth

from support.synthetic import sphere
from warp_trunk import Surface

GOOD = Smoothness(edges=(0.9, 1.1), most_edges=(0.95, 1.05), fold=8.0, most_fold=4.0)
BEFORE = [{"T9": 8.0, "T10": 10.0, "L1": 4.0}.get(level, 0.0) for level in LEVELS]
ROW = Row(
    patient="thoracic 60",
    correction=0.7,
    way="follow",
    derotation=14.0,
    before=BEFORE,
    after=[0.6 * value for value in BEFORE],
    shoulders_before=Shoulders(20.0, [6.0, 4.0]),
    shoulders_after=Shoulders(5.0, [3.0, 1.0]),
    less=[0.65 * value for value in BEFORE],
    smooth=GOOD,
    truth_before=Distance(18.0, 40.0),
    truth_after=Distance(5.2, 14.0),
    iterations=1200,
    inverted=0,
    status="CONVERGED",
)


def changed(level: str, by: float) -> Row:
    after = [value + by * (level == name) for name, value in zip(LEVELS, ROW.after, strict=True)]
    return replace(ROW, after=after)


def test_the_hump_is_told_where_it_was_largest() -> None:
    assert LEVELS[ROW.apex] == "T10"
    assert ROW.over_cobb == pytest.approx(0.4 / 0.7)
    assert ROW.of_less == pytest.approx(0.5)


@pytest.mark.parametrize(("level", "levels"), [("T1", ABOVE), ("T2", ABOVE), ("L3", BELOW), ("L4", BELOW)])
def test_an_end_that_changes_by_more_than_the_apex_is_told(level: str, levels: slice) -> None:
    assert ROW.quiet(levels)
    assert changed(level, -3.9).quiet(levels)
    assert not changed(level, 4.1).quiet(levels)


def test_the_upper_back_is_told_along_the_shoulders_too() -> None:
    sloping = changed("T1", -7.0)
    assert not sloping.quiet(ABOVE)
    assert sloping.quiet_along  # 3 degrees, and 4 at the apex
    assert not replace(sloping, shoulders_after=Shoulders(5.0, [1.9, 1.0])).quiet_along
    assert "| 0.29 | 0.5 | -7.0 (-3.0) | +0.0; +0.0 | 20 to 5 |" in by_patient([sloping]).splitlines()[2]


def test_a_skin_that_grows_is_stretched_and_not_folded() -> None:
    ball = sphere(50.0)
    found = smoothness(ball, Surface(1.15 * ball.vertices, ball.faces))
    assert (*found.edges, *found.most_edges) == pytest.approx((1.15,) * 4)
    assert found.fold == pytest.approx(0.0, abs=1e-9)
    assert found.good
    assert not smoothness(ball, Surface(1.25 * ball.vertices, ball.faces)).good


def test_distance_from_truth_by_way() -> None:
    ball = sphere(50.0)
    found = distance(Surface(ball.vertices + np.array([3.0, 0.0, 4.0]), ball.faces), ball)
    assert (found.mean, found.most) == pytest.approx((5.0, 5.0))
    spline = replace(ROW, way="spline", truth_after=Distance(9.7, 27.0))
    table = by_truth([ROW, spline, replace(spline, correction=0.5)]).splitlines()
    assert (table[0], table[2:]) == (
        "| curve | before | spline | follow |",
        ["| thoracic 60 | 18.0; 40 | 9.7; 27 | 5.2; 14 |"],
    )


def test_tables_tell_each_way_and_how_bars_are_met() -> None:
    rough = replace(changed("T1", 9.0), way="spline", smooth=replace(GOOD, fold=30.0), less=None, inverted=3)
    rows = by_patient([ROW, rough]).splitlines()
    assert rows[2].startswith("| thoracic 60 | follow | T10, 10.0 | -, -, 0.57, - | 0.29 | 0.5 |")
    assert "0.90 to 1.10 (0.95 to 1.05) | 30 (4) | 1200 | 3 | CONVERGED |" in rows[3]
    bars = {line.split(" | ")[0]: line for line in by_bar([ROW, rough]).splitlines()}
    assert (
        "1 of 1 plans within | 0.57 to 0.57, 1 of 1" in bars["| change of the hump over that of Cobb 0.58 ± 0.08"]
    )
    assert bars["| no level above T3 changes by more than the apex"].endswith("| 0 of 1 | 1 of 1 |")
    assert bars["| plans with inverted tetrahedra, the most of them"].endswith("| 1 of 1, 3 | 0 of 1, 0 |")
    assert by_share({"more": changed("T1", 0.5)}, ROW).splitlines()[2].startswith("| more | +0.5 | +0.0 |")
