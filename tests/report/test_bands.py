"""Intervals in report, viewer and measures."""

import json
import re
from pathlib import Path

import pytest

from support.asserting import there
from support.report_results import small_bands, write_small_result
from support.small_trunk import small_case
from warp_trunk.cli.measure import Measure
from warp_trunk.measures.quantities import Measured, MeasureTable
from warp_trunk.report.page import BAND_HEAD, band_table, source_table
from warp_trunk.results import read_result

FOUND = small_bands(len(small_case()[0].skin.vertices))
BANDS = FOUND.bands


def test_every_measure_with_a_band_has_its_row(tmp_path: Path) -> None:
    read = read_result(write_small_result(tmp_path, found=FOUND))
    table = band_table(read.table, BANDS)
    rows = {row[0]: row[1:] for row in table}
    of_t4 = rows["Rotation of the back (BSR) at T4 [°]"]
    assert of_t4 == ["12 right", "1.5", "9.1 right", "15 right", "0.5", "no"]
    assert [row[1] for row in table if row[0].startswith("Hump")] == ["11 right"]
    assert source_table(BANDS) == [["landmarks", "2.1 +- 1.5 mm", "1.4", "0.7", "section <5.2> of [2]"]]
    assert all(len(row) == len(BAND_HEAD) for row in table)


def test_measures_say_which_levels_lie_in_their_band(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = write_small_result(tmp_path / "result", turn_more=2.0, found=FOUND)
    Measure(skin=result, against=result / "actual_skin.ply", out=tmp_path).run()
    said = capsys.readouterr().out
    record = json.loads((tmp_path / "measures.json").read_text())
    inside, table = record["levels_in_band"], MeasureTable(Measured(**row) for row in record["measures"])
    for level, band in read_result(result).table.column("predicted", "bsr_deg").items():
        actual = table.value("actual", "bsr_deg", level)
        assert inside[level] == (abs((actual or 0.0) - (band.value or 0.0)) <= 1.96 * 1.5)
    found = there(re.search(r"in its 95 % band at (\d) of 4 levels", said))
    assert int(found[1]) == sum(inside.values())
