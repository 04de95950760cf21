"""The table of quantities as rows, cells and sentences, of trunks and spines whose angles are known."""

import numpy as np
import polars as pl
import pytest

from support.known_spine import known_spine
from warp_trunk.measures.measures import measure_spine
from warp_trunk.measures.quantities import COLUMNS, QUANTITIES, Measured, MeasureTable
from warp_trunk.measures.rows import STATES, MeasureRow, measure_rows


@pytest.mark.parametrize(("share", "after"), [(0.3, ["12", "18", "9.0"]), (-0.1, ["−4.0", "−6.0", "−3.0"])])
def test_every_curve_is_followed_between_the_same_vertebrae_also_beyond_zero(share, after):
    tilts, states = {"T1": -10.0, "T5": 30.0, "T12": -30.0, "L4": 0.0}, {}
    for state, part in zip(STATES, (1.0, share), strict=True):
        states[state] = measure_spine(known_spine(to_left={level: part * tilt for level, tilt in tilts.items()}))
    groups = measure_rows(MeasureTable.of(states), states[STATES[0]]).values()
    rows = [row for group in groups for row in group if row.name.startswith("Cobb")]
    assert [row.short for row in rows] == [f"Cobb angle {ends}" for ends in ("T1 to T5", "T5 to T12", "T12 to L4")]
    assert [row.compared_cells()[1:3] for row in rows] == list(
        map(list, zip(["40", "60", "30"], after, strict=True))
    )


@pytest.mark.parametrize(
    ("was", "will", "sd", "cells"),
    [
        (2.0, 14.0, 2.0, ["14 right", "12 worse ▲"]),
        (2.0, 14.0, None, ["14 right", "12 worse"]),  # no interval
        (2.0, 14.0, 7.0, ["14 right", "12 worse"]),  # not certain
        (2.0, 2.6, 0.1, ["2.6 right", "0.6 worse"]),  # not visible
        (6.0, 9.0, 6.0, ["not known", "–"]),  # 11.8 is more than 9, than the change, and than 5 that can be seen
        (6.0, 9.0, 4.0, ["9.0 right", "3.0 worse"]),
        (20.0, 6.0, 4.0, ["6.0 right", "14 better"]),  # 7.8 is less than the change
    ],
)
def test_what_is_worse_for_certain_is_marked_and_what_an_interval_swallows_is_dropped(was, will, sd, cells):
    after = Measured("predicted", "", "shoulder_difference_mm", will)
    if sd is not None:
        after = Measured.with_sd("predicted", "", "shoulder_difference_mm", will, sd)
    numbers = (Measured("before", "", "shoulder_difference_mm", was), after)
    row = MeasureRow(quantity=QUANTITIES["shoulder_difference_mm"], level="", numbers=numbers)
    assert row.compared_cells()[2:] == cells


def test_an_interval_holds_95_percent_and_takes_the_place_of_a_row():
    row = Measured.with_sd("predicted", "T12", "bsr_deg", 10.0, 2.0)
    assert (row.low, row.high, row.sd) == pytest.approx((6.08, 13.92, 2.0), abs=1e-3)
    assert [row.holds(value) for value in (6.0, 6.1, None)] == [False, True, None]
    table = MeasureTable([Measured("predicted", "T12", "bsr_deg", 9.0), Measured("before", "T12", "bsr_deg", 7.0)])
    new = table.with_rows([row])
    assert len(new.rows) == len(table.rows)
    assert new.column("predicted", "bsr_deg")["T12"] is row


def table_of_unknown(first):
    rows = [Measured("before", "T8", "bsr_deg", 1.0, first, first)] * 1000
    return MeasureTable([*rows, Measured("predicted", "T9", "bsr_deg", None, 0.5, 2.0)])


@pytest.mark.parametrize("first", [None, 1.0])
def test_columns_are_typed_also_where_the_first_thousand_numbers_are_not_known(first):
    """polars infers types of dictionaries from the first hundred rows."""
    frame = pl.DataFrame(table_of_unknown(first).to_columns())
    assert tuple(frame.columns) == COLUMNS
    assert frame.schema["low"] == frame.schema["value"] == pl.Float64
    assert frame["low"][-1] == 0.5
    assert frame["state"].to_list()[-2:] == ["before", "predicted"]
    assert np.isnan(frame["value"].to_numpy()[-1])


def test_columns_are_a_frame_of_pandas():
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    frame = pandas.DataFrame(table_of_unknown(None).to_columns())
    assert [str(kind) for kind in frame.dtypes[-3:]] == ["float64"] * 3
    assert frame.set_index("level").loc["T9", "low"] == 0.5
