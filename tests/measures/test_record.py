"""Measures as JSON, as rows and as text: nothing lost, and nothing missing passed off as zero."""

import json
import re

import pytest

from support.trunk_shapes import ellipse, rotation, spine, tube
from warp_trunk.measures import compare_skins, measure
from warp_trunk.measures.record import COLUMNS, comparison_record, measures_record, rows
from warp_trunk.measures.table import measures_text

LEVELS = {"T3": 420.0, "T4": 350.0, "T12": 200.0, "L5": 50.0}


@pytest.fixture(scope="module")
def turned():
    """An elliptic trunk turned by 10 degrees, shorter than its spine, and one that is not turned."""
    landmarks = spine(LEVELS, (0.0, 0.0))
    trunk, straight = tube(ellipse() @ rotation(-10.0).T, rows=20), tube(ellipse(), rows=20)
    return measure(trunk, landmarks), compare_skins(trunk, straight, landmarks)


def test_rows_name_every_number_once(turned):
    record = {"skin": measures_record(turned[0]), "against": comparison_record(turned[1])}
    found = list(rows(json.loads(json.dumps(record, allow_nan=False))))
    places = [row[:2] for row in found]
    assert len(set(places)) == len(places)
    assert all(len(row) == len(COLUMNS) for row in found)
    values = {row[:2]: row[2] for row in found}
    assert values["skin levels T12", "bsr_deg"] == pytest.approx(10.0, abs=1e-6)
    assert values["skin levels T3", "bsr_deg"] is None
    assert values["against bsr_error T4-T12", "mean_deg"] == pytest.approx(10.0, abs=1e-6)
    assert values["against bsr_error T4-T12", "levels"] == "T4 T12"
    assert values["against bsr_error T4-T12", "undetectable"] is False
    assert values["against distance back", "rms_mm"] > 1.0
    assert values["against distance lumbar, back left", "area_cm2"] > 1.0


def test_text_says_what_is_missing_and_why(turned):
    text = measures_text(turned[0])
    (level,) = [line for line in text.splitlines() if line.startswith("T3 ")]
    assert level.split() == ["T3"] + ["–"] * 6
    assert "missing: T3: the plane at z = 420 mm misses the skin" in text
    assert "missing: trunk_shift: no landmarks of C7 or T1" in text
    assert re.search(r"largest from T1 to T12 \[°\] +10 right", text)
    assert "-0.0" not in text
