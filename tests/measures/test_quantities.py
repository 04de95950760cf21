"""The table of quantities as rows, text and sentences, of trunks and spines whose angles are known."""

import re

import numpy as np
import polars as pl
import pytest

from support.known_spine import known_spine
from support.trunk_shapes import ellipse, posed, rotation, spine, tube
from warp_trunk.measures import compare_skins, measure
from warp_trunk.measures.comparison import comparison_rows
from warp_trunk.measures.quantities import COLUMNS, QUANTITIES, Measured, MeasureTable, measured
from warp_trunk.measures.rows import STATES, MeasureRow, level_rows, measure_rows, measures_text
from warp_trunk.report.headlines import headlines
from warp_trunk.report.sentences import sentences
from warp_trunk.report.style import BEFORE, PREDICTED

LEVELS = {"T3": 420.0, "T4": 350.0, "T12": 200.0, "L5": 50.0}


@pytest.fixture(scope="module")
def turned():
    """An elliptic trunk turned by 10 degrees, shorter than its spine, and one that is not turned."""
    landmarks = spine(LEVELS, (0.0, 0.0))
    trunk, straight = tube(ellipse() @ rotation(-10.0).T, rows=20), tube(ellipse(), rows=20)
    return measure(trunk, landmarks), compare_skins(trunk, straight, landmarks)


def test_the_table_has_every_number_once_and_is_one_of_polars(turned):
    table = MeasureTable([*measured("predicted", turned[0]), *comparison_rows(turned[1])])
    frame = pl.DataFrame(table.to_columns())
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
    row = Measured.with_sd("predicted", "T12", "bsr_deg", 10.0, 2.0)
    assert (row.low, row.high, row.sd) == pytest.approx((6.08, 13.92, 2.0), abs=1e-3)
    assert [row.holds(value) for value in (6.0, 6.1, None)] == [False, True, None]
    new = table.with_rows([row])
    assert len(new.rows) == len(table.rows)
    assert new.column("predicted", "bsr_deg")["T12"] is row


def test_text_says_what_is_missing_and_why(turned):
    text = measures_text(turned[0], turned[0])
    (level,) = [line for line in text.splitlines() if line.startswith("T3 ")]
    assert level.split() == ["T3"] + ["–"] * 6
    assert "missing: T3: the plane at z = 420 mm misses the skin" in text
    assert "missing: trunk_shift: no landmarks of C7 or T1" in text
    assert re.search(r"upper back \(BSR\) at T4 \[°\] +10 right", text)
    assert "-0.0" not in text


THORACIC = {"T1": -10.0, "T5": 30.0, "T12": -30.0, "L4": 0.0}


def scaled(angles, share):
    return {level: share * angle for level, angle in angles.items()}


def poses(before, planned, turned=(12.0, 4.0), **options):
    return [
        posed(BEFORE, known_spine(to_left=before, **options), turned[0]),
        posed(PREDICTED, known_spine(to_left=planned, **options), turned[1]),
    ]


def table_of(states):
    return MeasureTable.of(dict(zip(STATES, (state.measures for state in states), strict=True)))


def compared(states):
    """The compared cells of every row, by title."""
    groups = measure_rows(table_of(states), states[0].measures)
    return {row.title: row.compared_cells()[1:] for rows in groups.values() for row in rows}


def test_a_left_curve_and_a_left_hump_that_improve_become_less():
    """Mirrored, a thoracic 60 with its hump on the left: sizes fall, and no change is printed as more."""
    left = poses(scaled(THORACIC, -1.0), scaled(THORACIC, -0.3), turned=(-12.0, -4.0))
    rows = compared(left)
    (upper,) = [cells for title, cells in rows.items() if title.startswith("Rotation of the upper back")]
    assert upper == ["12 left", "4.0 left", "8.0 better"]
    kinds = ("Rotation of the upper", "Rotation of the lower", "Main hump", "Cobb")
    improved = [cells[2] for title, cells in rows.items() if title.startswith(kinds)]
    assert len(improved) == 6
    assert all(change.endswith("better") for change in improved)
    levels = level_rows(table_of(left))
    assert all(row.compared_cells()[3].endswith("better") for row in levels)
    said = sentences(table_of(left), headlines(table_of(left), left[0].measures.cobb))
    assert "left side of the back still stands further back, by 4 degrees" in said["What will not change"]
    assert "Cobb" not in " ".join(said.values())


def test_every_curve_is_followed_between_the_same_vertebrae():
    both = poses(THORACIC, scaled(THORACIC, 0.3))
    groups = measure_rows(table_of(both), both[0].measures)
    curves = {"T1 to T5": (40.0, 12.0), "T5 to T12": (60.0, 18.0), "T12 to L4": (30.0, 9.0)}
    assert [name.split(",")[0] for name in groups if name.startswith("Curve")] == [
        f"Curve {ends}" for ends in curves
    ]
    cobb = [row for rows in groups.values() for row in rows if row.name.startswith("Cobb")]
    for row, (ends, angles) in zip(cobb, curves.items(), strict=True):
        assert row.short == f"Cobb angle {ends}"
        assert row.values == pytest.approx(angles, abs=1e-6)
    over = compared(poses(THORACIC, scaled(THORACIC, -0.1)))  # overcorrected: below zero
    assert [cells[1] for title, cells in over.items() if title.startswith("Cobb")] == ["−4.0", "−6.0", "−3.0"]


@pytest.mark.parametrize(
    ("was", "will", "change"),
    [
        (7.0, 9.0, "2.0 worse"),
        (7.0, -5.0, "12, other side"),
        (3.6, -3.8, "7.4, other side"),
        (9.0, 7.0, "2.0 better"),
    ],
)
def test_differences_are_sizes_with_a_word(was, will, change):
    assert compared_row("shoulder_difference_mm", was, will)[3] == change
    assert compared_row("spine_height_mm", 386.0, 404.0)[3] == "18 more"


def compared_row(key, was, will, sd=None):
    after = Measured("predicted", "", key, will)
    if sd is not None:
        after = Measured.with_sd("predicted", "", key, will, sd)
    numbers = (Measured("before", "", key, was), after)
    return MeasureRow(quantity=QUANTITIES[key], level="", numbers=numbers).compared_cells()


def test_only_what_is_visibly_and_certainly_worse_is_marked():
    assert compared_row("shoulder_difference_mm", 2.0, 14.0, 2.0)[3] == "12 worse ▲"
    for will, sd in ((14.0, None), (14.0, 9.0), (2.6, 0.1)):  # no interval, not certain, not visible
        assert "▲" not in "".join(compared_row("shoulder_difference_mm", 2.0, will, sd))


def test_a_number_whose_interval_is_wider_than_what_it_says_is_dropped():
    """Half of the interval is 11.8: more than 9, than the change of 3, and than 5 that can be seen."""
    assert compared_row("shoulder_difference_mm", 6.0, 9.0, 6.0)[2:] == ["not known", "–"]
    assert compared_row("shoulder_difference_mm", 6.0, 9.0, 4.0)[2:] == ["9.0 right", "3.0 worse"]


@pytest.mark.parametrize("first", [None, 1.0])
def test_columns_are_typed_also_where_the_first_thousand_numbers_are_not_known(first):
    """polars infers types of dictionaries from the first hundred rows."""
    rows = [Measured("before", "T8", "bsr_deg", 1.0, first, first)] * 1000
    rows += [Measured("predicted", "T8", "bsr_deg", None, 0.5, 2.0)]
    frame = pl.DataFrame(MeasureTable(rows).to_columns())
    assert frame.schema["low"] == frame.schema["value"] == pl.Float64
    assert frame["low"][-1] == 0.5
    assert frame["state"].to_list()[-2:] == ["before", "predicted"]
    assert np.isnan(frame["value"].to_numpy()[-1])


def test_columns_are_a_frame_of_pandas():
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    rows = [
        Measured("before", "T8", "bsr_deg", 1.0, None, None),
        Measured("before", "T9", "bsr_deg", None, 0.5, 2.0),
    ]
    frame = pandas.DataFrame(MeasureTable(rows).to_columns())
    assert [str(kind) for kind in frame.dtypes[-3:]] == ["float64"] * 3
    assert frame["low"].isna().tolist() == [True, False]
    assert frame.set_index("level").loc["T8", "value"] == 1.0
