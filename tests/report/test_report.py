"""Content of the report for every kind of result."""

import json
import re
from base64 import b64encode
from hashlib import sha256
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from support.report_results import write_small_result
from warp_trunk.cli import main
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.report.page import rotation_table
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
    assert {script.get("type") for script in page.of("script")} == {None, "application/json", "text/plain"}
    assert not page.of("link")
    assert len(page.of("img")) == len(PICTURES)
    for image in page.of("img"):
        assert image["src"].startswith("data:image/svg+xml;base64,")
        assert len(image["alt"]) > 20
    assert "http" not in re.sub(r'base64,[^"]*|plain">[^<]*', "", plain[1]).replace("http-equiv", "")
    policy = next(meta["content"] for meta in page.of("meta") if "http-equiv" in meta)
    assert "default-src 'none'" in policy
    script = re.search(r"<script>(.*?)</script>", plain[1], re.DOTALL)
    assert script is not None
    digest = b64encode(sha256(script[1].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy
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


def test_command_writes_the_same_bytes_elsewhere_and_says_where(plain, tmp_path, capsys):
    assert main(["report", str(plain[0]), "--out", str(tmp_path / "taken along")]) == 0
    page = tmp_path / "taken along" / "report.html"
    assert str(page) in capsys.readouterr().out
    assert page.read_text() == plain[1]
    for name in PICTURES:
        again = page.parent / "report" / f"{name}.png"
        assert again.read_bytes() == (plain[0] / "report" / f"{name}.png").read_bytes()
