"""Content of the report for every kind of result, with its intervals."""

import json
import re
import subprocess
import sys
from base64 import b64encode
from dataclasses import replace
from hashlib import sha256
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from support.asserting import not_none
from support.drawn import drawn_figures
from support.report_results import small_bands, write_small_result
from support.small_trunk import small_case
from support.synthetic import box
from warp_trunk.cli import main
from warp_trunk.cli.measure import Measure
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.measures.back_rotation import FLANK, ROUND
from warp_trunk.measures.number_text import interval_text
from warp_trunk.measures.quantities import QUANTITIES, Measured, MeasureTable
from warp_trunk.measures.rows import MeasureRow, rotation_table
from warp_trunk.report.headlines import Headline, headlines
from warp_trunk.report.page import (
    BAND_HEAD,
    STATES,
    band_table,
    change_table,
    in_numbers,
    left_out,
    source_table,
)
from warp_trunk.report.sentences import option_rows
from warp_trunk.report.writing import write_report
from warp_trunk.results import read_result

PICTURES = [
    "back", "convergence", "front", "hump", "rotation", "sections", "side", "spine_behind", "spine_side",
    "stretch_behind",
]  # fmt: skip


class Elements(HTMLParser):
    """The elements of a page, its words, and the cells of its tables."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.words = [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.words += data

    def of(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture
def plain(plain_report):
    return plain_report.parent, plain_report.read_text(encoding="utf-8")


@pytest.fixture
def compared(compared_report):
    return compared_report.parent, compared_report.read_text(encoding="utf-8")


def test_page_and_pictures_are_written_whole(plain):
    folder, _ = plain
    assert sorted(path.name for path in (folder / "report").iterdir()) == [f"{name}.png" for name in PICTURES]
    assert not list(folder.glob("*partial*"))
    for name in PICTURES:
        with Image.open(folder / "report" / f"{name}.png") as picture:
            assert len(np.unique(np.array(picture.convert("L")))) > 20, name


def test_page_needs_nothing_and_reaches_for_nothing(plain):
    page = Elements(plain[1])
    assert {script.get("type") for script in page.of("script")} == {None, "application/json", "text/plain"}
    assert not page.of("link")
    assert len(page.of("img")) == len(PICTURES)
    for image in page.of("img"):
        assert re.match(r"data:image/(svg\+xml|webp);base64,", image["src"])
        assert len(image["alt"]) > 20
    assert "http" not in re.sub(r'base64,[^"]*|plain">[^<]*', "", plain[1]).replace("http-equiv", "")
    policy = next(meta["content"] for meta in page.of("meta") if "http-equiv" in meta)
    assert "default-src 'none'" in policy
    script = not_none(re.search(r"<script>(.*?)</script>", plain[1], re.DOTALL))
    digest = b64encode(sha256(script[1].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy
    assert '<script>alert("x")</script> & Co' in page.words  # what comes from files is text
    assert "actual, after surgery" not in page.words


def test_numbers_of_the_prediction_are_the_angles_that_were_imposed(plain):
    """The box is turned by 14 degrees over 420 mm, evenly with height; clockwise from above is positive."""
    rows = rotation_table(read_result(plain[0]).table, STATES[:2], MeasureRow.compared_cells)
    heights = {"T4": 360.0, "T8": 280.0, "T12": 200.0, "L3": 120.0}
    for level, before, predicted, change in rows:
        assert before == "0.0"
        size, side = predicted.split()
        assert float(size) == pytest.approx(14.0 * heights[level] / 420.0, abs=0.5 if len(size) == 2 else 0.1)
        assert side == "right"
        assert change == f"{size} worse"  # without an interval that is not certain


def test_actual_skin_brings_its_error(compared):
    """It is turned by 3 degrees more everywhere: that is the mean absolute error, and more than a surgeon
    detects."""
    words = Elements(compared[1]).words
    assert "predicted rotation is 3.0 degrees on average, no less than the 2.5 degrees" in words
    assert re.search(r"Rotation of the back, mean absolute error T3-L5 \[°\]\s*3\.0\d ± 0\.0", words)
    assert "actual, after surgery" in words
    table = rotation_table(read_result(compared[0]).table, STATES, MeasureRow.compared_cells)
    rows = {level: cells for level, *cells in table}
    assert [float(row[-1]) for row in rows.values() if row[-1] != "–"] == pytest.approx([3.0] * 3, abs=0.05)
    assert rows["T8"] == ["–"] * 5  # a level that was not measured


def test_result_that_did_not_converge_says_so_first_and_predicts_nothing(tmp_path):
    """It has no estimate of its error either, as when its first step already fails."""
    folder = write_small_result(tmp_path, status=RelaxStatus.STALLED)
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    for row in summary["increments"]:
        row["estimated_error_mm"] = None
    del summary["parameters"]["tolerance"]
    (folder / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    with drawn_figures():
        text = write_report(read_result(folder)).read_text(encoding="utf-8")
    assert text.index("did not reach its end (STALLED)") < text.index("<img")
    assert "What changes" not in text
    assert RelaxStatus.STALLED.value[1:] in Elements(text).words


def test_command_writes_the_same_bytes_elsewhere_and_says_where(plain, tmp_path, capsys):
    assert main(["report", str(plain[0]), "--out", str(tmp_path / "taken along")]) == 0
    page = tmp_path / "taken along" / "report.html"
    assert str(page) in capsys.readouterr().out
    assert page.read_text(encoding="utf-8") == plain[1]
    for name in PICTURES:
        again = page.parent / "report" / f"{name}.png"
        assert again.read_bytes() == (plain[0] / "report" / f"{name}.png").read_bytes()


def test_a_report_draws_without_loading_warp_or_the_viewer(plain, tmp_path):
    """That costs as much as all pictures of the spine; nor can a report wait for kernels that are compiled."""
    command = f"from warp_trunk.cli import main; main(['report', {str(plain[0])!r}, '--out', {str(tmp_path)!r}])"
    code = f"{command}; import sys; sys.exit(bool({{'warp', 'rerun'}} & {{*sys.modules}}))"
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
    assert (tmp_path / "report.html").is_file()


def test_front_is_bare_only_where_that_is_asked_for(plain, tmp_path):
    with drawn_figures():
        assert main(["report", str(plain[0]), "--views", "bare", "--out", str(tmp_path)]) == 0
    names = {path.stem for path in (tmp_path / "report").iterdir()}
    assert names - set(PICTURES) == {"bare_front", "bare_side", "stretch_front"}
    assert "Without clothes" in Elements((tmp_path / "report.html").read_text(encoding="utf-8")).words
    assert "Without clothes" not in Elements(plain[1]).words


def test_a_plan_and_bands_are_on_the_page(plain, tmp_path):
    """Fused vertebrae, the fingerprint of the plan, intervals, and a better and a worse back."""
    folder = write_small_result(tmp_path, intervals=small_bands(len(small_case()[0].skin.vertices)))
    (folder / "plan.toml").write_text(
        'uiv = "T4"\nliv = "L1"\n[[curve]]\napex = "T8"\ncorrection = 0.65\n', encoding="utf-8"
    )
    with drawn_figures():
        page = write_report(read_result(folder))
    words = " ".join(Elements(page.read_text(encoding="utf-8")).words.split())
    assert words.count("The 10 vertebrae from T4 to L1 are joined") == 2  # for the patient, and to sign
    assert "Plan: T4 to L1 joined (10 vertebrae); curve at T8: 65 % of the Cobb angle corrected." in words
    assert "A scar runs along the vertebrae from T4 to L1." in words
    first = read_result(folder).fingerprint
    assert first in words
    assert re.fullmatch(r"[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}", first)
    (folder / "plan.toml").write_text('uiv = "T4"\nliv = "L2"\n', encoding="utf-8")
    assert read_result(folder).fingerprint != first
    assert "It can turn out better or worse" in words
    assert "19 of 20: " in words
    assert (folder / "report" / "likely.png").exists()
    without = " ".join(Elements(plain[1]).words.split())
    assert without.count("without a plan of fusion") == 1
    assert "No interval was computed for these numbers" in without
    for said in ("rods", "scar runs", "Joined vertebrae", "as planned: "):
        assert said not in without


@pytest.mark.parametrize(
    ("key", "was", "will", "text", "name", "word"),
    [
        ("shoulder_difference_mm", 6.7, 9.4, "7 → 9 mm", "shoulders, the right one higher", "no visible change"),
        ("shoulder_difference_mm", 6.7, -4.6, "7 mm right → 5 mm left", "shoulders", "other side"),
        ("main_hump_mm", 12.0, 22.0, "12 → 22 mm", "hump at T8, on the right", "visibly worse"),
        ("cobb_deg", 55.0, -4.0, "55 → −4°", "curve of the spine, T8", "visibly better"),
        ("bsr_deg", -3.6, 3.8, "4° left → 4° right", "rotation of the back at T8", "other side"),
        (
            "bsr_deg",
            12.0,
            0.3,
            "12 → 0°",
            "rotation of the back at T8, the right side further back",
            "visibly better",
        ),
        ("waist_height_mm", -8.0, -2.0, "8 → 2 mm", "waist, height, the left one higher", "visibly better"),
        ("spine_height_mm", 386.0, 403.4, "+17 mm", "height of the spine", ""),
    ],
)
def test_every_tile_has_its_side_and_its_word(key, was, will, text, name, word):
    tile = Headline(QUANTITIES[key], was, Measured.with_sd("predicted", "T8", key, will, 1.0))
    assert (tile.text, tile.name, tile.word) == (text, name, word)
    assert tile.is_worse == (word == "visibly worse")
    held = replace(tile, after=Measured.with_sd("predicted", "", key, will, 90.0))
    assert (held.is_known, held.text) == (False, "not known")
    assert replace(held, fixed="held by the plan").word == "held by the plan"
    assert replace(held, fixed="held by the plan").interval == ""


@pytest.mark.parametrize(("will", "text"), [(14.2, "14 mm"), (15.0, "14 → 15 mm")])
def test_what_the_plan_holds_is_stated_once_where_it_stays(will, text):
    tile = Headline(
        QUANTITIES["main_hump_mm"], 14.0, Measured("predicted", "T8", "main_hump_mm", will), None, "held"
    )
    assert tile.text == text
    assert in_numbers([tile]) == f"{tile.name}: {text}, held"
    assert in_numbers([replace(tile, fixed="", quantity=QUANTITIES["spine_height_mm"])]).endswith(" mm")


def test_movement_of_a_box_whose_top_is_raised():
    """A box of 100 mm, its top by 3 mm: half of its 600 cm2 of skin belongs to the top's vertices, and 30 cm3 are
    gained."""
    before = box((100.0, 100.0, 100.0))
    top = before.vertices[:, 2] > 0.0
    raised = replace(before, vertices=before.vertices + np.outer(top, [0.0, 0.0, 3.0]))
    numbers = dict(change_table(before, raised))
    corner = numbers.pop("Where that is before surgery: x, y, z [mm]")
    assert corner.endswith(", 50)")
    assert list(numbers.values()) == ["3.0", "300", "30.0", "0.0", "0"]
    assert list(dict(change_table(raised, before)).values())[3:] == ["0.0", "30.0", "0"]


def test_a_tile_names_the_place_that_is_larger_afterwards():
    larger = Measured("predicted", "T8", "hump_mm", 17.2)
    tile = Headline(QUANTITIES["main_hump_mm"], 25.0, Measured("predicted", "T12", "main_hump_mm", 10.0), larger)
    assert (tile.text, tile.note) == ("25 → 10 mm", "now largest at T8, 17 mm")


def test_intervals_name_both_sides_where_they_hold_both():
    assert interval_text(Measured("predicted", "", "a", 5.0, -13.0, 23.0), sided=True) == "13 left to 23 right"
    assert interval_text(Measured("predicted", "", "a", -8.0, -14.0, -3.0), sided=True) == "3 to 14"
    assert interval_text(Measured("predicted", "", "a", 19.0, -1.9, 40.0), sided=False) == "−2 to 40"
    assert interval_text(Measured("predicted", "", "a", 19.0), sided=False) == ""


def test_options_have_the_units_of_their_records() -> None:
    rows = dict(
        option_rows({"bone_voxel": 4.0, "tolerance": 0.1, "density": 1000.0, "gravity": 9.81, "theta": 10.0})
    )
    assert rows["bone voxel"] == "4 mm"
    assert rows["tolerance"] == "0.1 mm"
    assert rows["density"] == "1000 kg/m³"
    assert rows["gravity"] == "9.81 m/s²"
    assert rows["theta"] == "10"


OUTCOME_BANDS = small_bands(len(small_case()[0].skin.vertices))
BANDS = OUTCOME_BANDS.bands


def test_every_measure_with_a_band_has_its_row(tmp_path: Path) -> None:
    read = read_result(write_small_result(tmp_path, intervals=OUTCOME_BANDS))
    table = band_table(read.table, BANDS)
    rows = {row[0]: row[1:] for row in table}
    of_t4 = rows["Rotation of the back (BSR) at T4 [°]"]
    assert of_t4 == ["12 right", "1.5", "9 to 15", "0.5", "no"]
    assert [row[1] for row in table if "ump" in row[0]] == ["54 right"] * 2
    assert source_table(BANDS, "T4") == [["landmarks", "2.1 +- 1.5 mm", "1.4", "0.7", "section <5.2> of [2]"]]
    assert all(len(row) == len(BAND_HEAD) for row in table)


def test_measures_say_which_levels_lie_in_their_band(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = write_small_result(tmp_path / "result", turn_more=2.0, intervals=OUTCOME_BANDS)
    Measure(skin=result, against=result / "actual_skin.ply", out=tmp_path).run()
    said = capsys.readouterr().out
    record = json.loads((tmp_path / "measures.json").read_text(encoding="utf-8"))
    inside, table = record["levels_in_band"], MeasureTable(Measured(**row) for row in record["measures"])
    for level, band in read_result(result).table.column("predicted", "bsr_deg").items():
        actual = table.value("actual", "bsr_deg", level)
        assert inside[level] == (abs((actual or 0.0) - (band.value or 0.0)) <= 1.96 * 1.5)
    counted = not_none(re.search(r"in its 95 % band at (\d) of 4 levels", said))
    assert int(counted[1]) == sum(inside.values())


def test_a_number_that_is_missing_afterwards_is_not_known_and_its_levels_have_a_reason() -> None:
    table = MeasureTable(
        [
            Measured("before", "T9", "main_hump_mm", 11.0),
            Measured("predicted", "T9", "main_hump_mm", None),
        ]
    )
    (hump,) = headlines(table, [])
    assert (hump.text, hump.word, hump.interval, hump.note) == ("not known", "not known", "", "")
    assert hump.name == "hump at T9, on the right"
    before = {"hump T12": FLANK, "T1": ROUND, "waist": "it ends there"}
    after = {"hump T9": FLANK, "hump T12": FLANK}
    assert left_out(before, after) == [f"No hump at T9, T12: {FLANK}.", f"No rotation at T1: {ROUND}."]
