"""The table of quantities, and it as text: nothing lost, and nothing missing passed off as zero."""

import re

import polars as pl
import pytest

from support.trunk_shapes import ellipse, rotation, spine, tube
from warp_trunk.measures import compare_skins, measure
from warp_trunk.measures.comparison import comparison_rows
from warp_trunk.measures.quantities import COLUMNS, QUANTITIES, Measured, MeasureTable, measured
from warp_trunk.measures.rows import measures_text

LEVELS = {"T3": 420.0, "T4": 350.0, "T12": 200.0, "L5": 50.0}


@pytest.fixture(scope="module")
def turned():
    """An elliptic trunk turned by 10 degrees, shorter than its spine, and one that is not turned."""
    landmarks = spine(LEVELS, (0.0, 0.0))
    trunk, straight = tube(ellipse() @ rotation(-10.0).T, rows=20), tube(ellipse(), rows=20)
    return measure(trunk, landmarks), compare_skins(trunk, straight, landmarks)


def test_the_table_has_every_number_once_and_is_one_of_polars(turned):
    table = MeasureTable([*measured("predicted", turned[0]), *comparison_rows(turned[1])])
    frame = pl.DataFrame(table.to_rows())
    assert tuple(frame.columns) == COLUMNS
    assert len(frame.unique(["state", "level", "quantity"])) == len(frame) == len(table.rows)
    assert {row.quantity for row in table.rows if row.state == "predicted"} <= QUANTITIES.keys()
    assert table.value("predicted", "bsr_deg", "T12") == pytest.approx(10.0, abs=1e-6)
    assert table.value("predicted", "bsr_deg", "T3") is None
    assert table.value("error", "bsr_error_mean_deg", "T4-T12") == pytest.approx(10.0, abs=1e-6)
    for quantity, region in (("distance_rms_mm", "back"), ("area_cm2", "lumbar, back left")):
        assert (table.value("error", quantity, region) or 0.0) > 1.0


def test_an_interval_holds_95_percent_and_takes_the_place_of_a_row(turned):
    table = MeasureTable(measured("predicted", turned[0]))
    known = Measured.with_sd("predicted", "T12", "bsr_deg", 10.0, 2.0)
    assert (known.low, known.high, known.sd) == pytest.approx((6.08, 13.92, 2.0), abs=1e-3)
    assert [known.holds(value) for value in (6.0, 6.1, None)] == [False, True, None]
    new = table.with_rows([known])
    assert len(new.rows) == len(table.rows)
    assert new.column("predicted", "bsr_deg")["T12"] is known


def test_text_says_what_is_missing_and_why(turned):
    text = measures_text(turned[0])
    (level,) = [line for line in text.splitlines() if line.startswith("T3 ")]
    assert level.split() == ["T3"] + ["–"] * 6
    assert "missing: T3: the plane at z = 420 mm misses the skin" in text
    assert "missing: trunk_shift: no landmarks of C7 or T1" in text
    assert re.search(r"largest from T1 to T12 \[°\] +10 right", text)
    assert "-0.0" not in text
