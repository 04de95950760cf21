"""Content of the report: files, what a page reaches for, and words that the accepted texts do not hold."""

import json
import re
from base64 import b64encode
from dataclasses import replace
from hashlib import sha256
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from support.asserting import not_none
from support.drawn import Page, drawn_figures
from support.known_patient import ACTUAL, PLAN, SD, known_intervals, write_known_result
from support.known_spine import known_spine
from support.report_results import write_small_result
from support.synthetic import box
from warp_trunk.cli import main
from warp_trunk.cli.measure import Measure
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.measures.back_rotation import FLANK, ROUND
from warp_trunk.measures.number_text import interval_text
from warp_trunk.measures.quantities import QUANTITIES, Measured, MeasureTable
from warp_trunk.report.headlines import Headline, headlines
from warp_trunk.report.page import change_table, in_numbers, left_out
from warp_trunk.report.part_pictures import changed_views
from warp_trunk.report.sentences import band_sentence, option_rows, planned
from warp_trunk.report.writing import write_report
from warp_trunk.results import read_result
from warp_trunk.spine import cobb_angles
from warp_trunk.views.relief import BEHIND, FRONT, LEFT, RIGHT

PICTURES = [
    "back", "convergence", "front", "hump", "rotation", "sections", "side", "spine_behind", "spine_side",
    "stretch_behind",
]  # fmt: skip


def test_page_and_pictures_are_written_whole_and_reach_for_nothing(plain_report):
    """Drawn by a program of its own, which loads neither Warp nor the viewer; nothing of a file is markup."""
    text, folder = plain_report.read_text(encoding="utf-8"), plain_report.parent
    assert sorted(path.name for path in (folder / "report").iterdir()) == [f"{name}.png" for name in PICTURES]
    assert not list(folder.glob("*partial*"))
    for name in PICTURES:
        with Image.open(folder / "report" / f"{name}.png") as picture:
            assert len(np.unique(np.array(picture.convert("L")))) > 20, name
    assert set(re.findall(r'<script[^>]* type="([^"]*)"', text)) == {"application/json", "text/plain"}
    assert "<link" not in text
    pictures = re.findall(r'<img src="data:image/(?:svg\+xml|webp);base64,[^"]+" alt="([^"]{20,})"', text)
    assert len(pictures) == text.count("<img") == len(PICTURES)
    assert "http" not in re.sub(r'base64,[^"]*|plain">[^<]*', "", text).replace("http-equiv", "")
    policy = unescape(not_none(re.search(r'Content-Security-Policy" content="([^"]*)"', text))[1])
    assert "default-src 'none'" in policy
    script = not_none(re.search(r"<script>(.*?)</script>", text, re.DOTALL))
    digest = b64encode(sha256(script[1].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy
    assert "&lt;script&gt;alert(&#34;x&#34;)&lt;/script&gt; &amp; Co" in text
    assert "<script>alert" not in text


@pytest.mark.slow
def test_command_writes_the_same_bytes_elsewhere(plain_report, tmp_path):
    assert main(["report", str(plain_report.parent), "--out", str(tmp_path)]) == 0
    for again in (tmp_path / "report.html", *(tmp_path / "report").iterdir()):
        assert again.read_bytes() == (plain_report.parent / again.relative_to(tmp_path)).read_bytes()


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
    assert RelaxStatus.STALLED.value[1:] in Page(text).words


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
    for value, low, high, sided, text in (
        (5.0, -13.0, 23.0, True, "13 left to 23 right"),
        (-8.0, -14.0, -3.0, True, "3 to 14"),
        (19.0, -1.9, 40.0, False, "−2 to 40"),
        (19.0, None, None, False, ""),
    ):
        assert interval_text(Measured("predicted", "", "a", value, low, high), sided=sided) == text


@pytest.mark.parametrize(
    ("hump", "turn", "text"),
    [
        ((30.0, 2.0), (12.0, 1.0), "the hump at T8 would be between 26 and 34 mm"),
        ((30.0, 40.0), (12.0, 1.0), "the rotation at T8 would be between 10 and 14 degrees"),
        ((None, 1.0), (2.0, 2.0), "between 2 degrees with the left side further back and 6 with the right side"),
        ((30.0, 40.0), (12.0, 40.0), "are not known well enough for a likely range"),
        ((30.0, None), (12.0, None), "was not computed for this prediction"),
    ],
)
def test_the_likely_range_is_that_of_the_hump_or_else_of_the_rotation(hump, turn, text):
    rows = [Measured("before", "T8", key, size) for key, size in (("main_hump_mm", 60.0), ("bsr_deg", 20.0))]
    for key, (size, sd) in (("main_hump_mm", hump), ("bsr_deg", turn)):
        if size is not None:
            row = Measured("predicted", "T8", key, size)
            rows.append(row if sd is None else Measured.with_sd("predicted", "T8", key, size, sd))
    assert text in band_sentence(MeasureTable(rows), None)


def test_curves_that_follow_are_told_from_those_of_the_plan():
    """Of three curves T8's is asked; of the others those count that are known after surgery."""
    curves = cobb_angles(known_spine({"T1": 0.0, "T4": 20.0, "T11": -20.0, "L4": 12.0, "L5": 10.0}))
    levels = [f"T{i}" for i in range(1, 13)] + [f"L{i}" for i in range(1, 6)]
    rows = [Measured("predicted", curve.ends, "cobb_deg", 9.0) for curve in curves]
    asked = "The plan takes the curve from 40 to 9 degrees (T4 to T11, to the right)."
    first = "from 20 to 9 degrees (T1 to T4, to the left)"
    for own, more in (
        (rows[1:2], ""),
        (rows[:2], f" The other curve follows: {first}."),
        (rows, f" The other curves follow: {first} and"),
    ):
        assert planned(MeasureTable(own), curves, levels, PLAN).startswith(asked + more)
    assert planned(MeasureTable([]), curves, levels, PLAN) == "The spine has no curve of 10 degrees or more."


@pytest.mark.parametrize("most", [BEHIND, RIGHT, FRONT, LEFT], ids=["behind", "right", "front", "left"])
def test_a_part_is_seen_from_where_more_of_its_change_faces(most):
    """A cube moves by 1.5 mm on one side, which is first, and by 1 mm on the others; a neighbour is second."""
    skin = box((100.0, 100.0, 100.0), splits=3)
    out = {
        BEHIND: skin.vertices[:, 1],
        RIGHT: -skin.vertices[:, 0],
        FRONT: -skin.vertices[:, 1],
        LEFT: skin.vertices[:, 0],
    }
    size = np.where(out[most] > 49.0, 1.5, 1.0)
    first, second = changed_views(skin, size)
    assert first == most
    assert (second.turn - first.turn) % 2 == 1
    beside = [view for view in out if (view.turn - most.turn) % 2]
    for other in beside:
        assert changed_views(skin, np.where(out[other] > 49.0, 1.2, size))[1] == other


def test_options_have_the_units_of_their_records() -> None:
    for name, value, text in (
        ("bone_voxel", 4.0, "4 mm"),
        ("tolerance", 0.1, "0.1 mm"),
        ("density", 1000.0, "1000 kg/m³"),
        ("gravity", 9.81, "9.81 m/s²"),
        ("theta", 10.0, "10"),
        ("fit", True, "yes"),
        ("springs", None, "–"),
        ("levels", ["T1", "T2"], "T1, T2"),
    ):
        assert option_rows({name: value}) == [(name.replace("_", " "), text)]


def test_measures_say_which_levels_lie_in_their_band(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = write_known_result(tmp_path / "result", actual=ACTUAL, intervals=known_intervals())
    Measure(skin=result, against=result / "actual_skin.ply", out=tmp_path).run()
    said = capsys.readouterr().out
    record = json.loads((tmp_path / "measures.json").read_text(encoding="utf-8"))
    inside, table = record["levels_in_band"], MeasureTable(Measured(**row) for row in record["measures"])
    for level, band in read_result(result).table.column("predicted", "bsr_deg").items():
        actual = table.value("actual", "bsr_deg", level)
        assert inside[level] == (abs((actual or 0.0) - (band.value or 0.0)) <= 1.96 * SD)
    counted = not_none(re.search(r"in its 95 % band at (\d+) of 17 levels", said))
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
