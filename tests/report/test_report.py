"""Content of the report for every kind of result."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from support.report_results import write_small_result
from warp_trunk.cli import main
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.report.modelled import modelled, not_modelled
from warp_trunk.report.page import rotation_table
from warp_trunk.report.sentences import sentences
from warp_trunk.report.writing import poses_of
from warp_trunk.results import read_result

PICTURES = [
    "back", "convergence", "front", "hump", "rotation", "sections", "side", "spine_behind", "spine_side",
    "stretch_behind", "stretch_front",
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
    return plain_report.parent, plain_report.read_text()


@pytest.fixture
def compared(compared_report):
    return compared_report.parent, compared_report.read_text()


def test_page_and_pictures_are_written_whole(plain):
    folder, _ = plain
    assert sorted(path.name for path in (folder / "report").iterdir()) == [f"{name}.png" for name in PICTURES]
    assert not list(folder.glob("*partial*"))
    for name in PICTURES:
        with Image.open(folder / "report" / f"{name}.png") as picture:
            assert len(np.unique(np.array(picture.convert("L")))) > 20, name


def test_page_needs_nothing_and_reaches_for_nothing(plain):
    page = Elements(plain[1])
    assert not page.of("script")
    assert not page.of("link")
    assert len(page.of("img")) == len(PICTURES)
    for image in page.of("img"):
        assert image["src"].startswith("data:image/svg+xml;base64,")
        assert len(image["alt"]) > 20
    assert "http" not in re.sub(r"base64,[^\"]*", "", plain[1]).replace("http-equiv", "")
    policy = next(meta["content"] for meta in page.of("meta") if "http-equiv" in meta)
    assert "default-src 'none'" in policy
    assert "<script" not in plain[1]
    assert '<script>alert("x")</script> & Co' in page.words  # what comes from files is text
    assert "actual, after surgery" not in page.words


def test_numbers_of_the_prediction_are_the_angles_that_were_imposed(plain):
    """The box is turned by 14 degrees over 420 mm, evenly with height; clockwise from above is positive."""
    rows = rotation_table(poses_of(read_result(plain[0])))
    heights = {"T4": 360.0, "T8": 280.0, "T12": 200.0, "L3": 120.0}
    for level, before, predicted, change in rows:
        assert before == "0.0"
        size, side = predicted.split()
        assert float(size) == pytest.approx(14.0 * heights[level] / 420.0, abs=0.5 if len(size) == 2 else 0.1)
        assert side == "right"
        assert change == f"+{size}"


def test_sentences_name_the_level_the_side_and_the_angles(plain):
    said = sentences(poses_of(read_result(plain[0])), None)
    assert list(said) == ["What is planned", "What changes", "What stays", "How sure this is"]
    assert said["What is planned"] == "The spine has no curve of 10 degrees or more."
    assert "right side of the back then stands further back, by 12 degrees at vertebra T4" in said["What stays"]
    assert "not been compared with patients" in said["How sure this is"]


def test_actual_skin_brings_its_error(compared):
    """It is turned by 3 degrees more everywhere: that is the mean absolute error, and more than a surgeon
    detects."""
    words = Elements(compared[1]).words
    assert "predicted rotation is 3.0 degrees on average, no less than the 2.5 degrees" in words
    assert re.search(r"Rotation of the back, mean absolute error T3-L5 \[°\]\s*3\.0\d ± 0\.0", words)
    assert "actual, after surgery" in words
    rows = {row[0]: row[1:] for row in rotation_table(poses_of(read_result(compared[0])))}
    assert [float(row[-1]) for row in rows.values() if row[-1] != "–"] == pytest.approx([3.0] * 3, abs=0.05)
    assert rows["T8"] == ["–"] * 5  # a level that was not measured


def test_result_that_did_not_converge_says_so_first_and_predicts_nothing(tmp_path):
    """It has no estimate of its error either, as when its first step already fails."""
    folder = write_small_result(tmp_path, status=RelaxStatus.STALLED)
    summary = json.loads((folder / "summary.json").read_text())
    for row in summary["increments"]:
        row["estimated_error_mm"] = None
    del summary["parameters"]["tolerance"]
    (folder / "summary.json").write_text(json.dumps(summary))
    text = read_result(folder).report().read_text()
    assert text.index("did not reach its end (STALLED)") < text.index("<img")
    assert "What changes" not in text
    assert RelaxStatus.STALLED.value[1:] in Elements(text).words


def test_warnings_are_text_on_the_page_of_the_surgeon(tmp_path):
    folder = write_small_result(
        tmp_path, warnings=("The <b>pelvis</b> moves by 7 mm.", "The largest curve grows.")
    )
    text = read_result(folder).report().read_text()
    surgeon = text.index("For the surgeon:")
    assert text.index("<img") < text.index('role="alert"') < surgeon
    assert text.index("The &lt;b&gt;pelvis&lt;/b&gt; moves by 7 mm.") > surgeon
    assert text.index("The largest curve grows.") > surgeon


def test_appendix_says_what_increments_are_relaxed_to(plain):
    words = " ".join(Elements(plain[1]).words.split())
    assert "All increments but the last are relaxed only to twenty times the tolerance" in words
    assert "may stop at 0.2 mm" in words
    assert "the last one at 0.01 mm" in words
    assert words.index("load factor") > words.index("Appendix")


def test_what_was_modelled_follows_the_options(plain):
    summary = read_result(plain[0]).summary
    said, not_said = " ".join(modelled(summary)), " ".join(not_modelled(summary))
    assert "one elastic material" in said
    assert "springs" in said
    assert "already holds" in said
    assert "skin, fat and muscle" in not_said
    assert "joints" in not_said
    tissues = (Tissue(youngs_modulus=130.0), Tissue(youngs_modulus=2.5))
    options = {"bones": "follow", "gravity": 9.81, "rest": "sag-free"}
    other = replace(summary, tissues=tissues, terms=("shape", "gravity"), parameters=options)
    said, not_said = " ".join(modelled(other)), " ".join(not_modelled(other))
    assert "2 elastic materials" in said
    assert "130, 2.5 kPa" in said
    assert "neo-Hookean" in said
    assert "9.81 m/s²; the scan before surgery is in balance" in said
    assert "rigid body" in said
    assert "skin, fat" not in not_said
    assert "joints" not in not_said


def test_folder_that_cannot_be_written_is_refused_before_any_drawing(plain, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda *_, **__: pytest.fail("drawn"))
    with pytest.raises(InputError, match="--out"):
        read_result(plain[0]).report(tmp_path / "file" / "out")


def test_command_writes_the_same_bytes_elsewhere_and_says_where(plain, tmp_path, capsys):
    assert main(["report", str(plain[0]), "--out", str(tmp_path / "taken along")]) == 0
    page = tmp_path / "taken along" / "report.html"
    assert str(page) in capsys.readouterr().out
    assert page.read_text() == plain[1]
    for name in PICTURES:
        again = page.parent / "report" / f"{name}.png"
        assert again.read_bytes() == (plain[0] / "report" / f"{name}.png").read_bytes()


def test_command_refuses_what_is_no_result_in_one_line(tmp_path, capsys):
    assert main(["report", str(tmp_path)]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert re.fullmatch(r"warp-trunk: .*summary\.json: there is no such file; .*", last)
    assert list(tmp_path.iterdir()) == []
