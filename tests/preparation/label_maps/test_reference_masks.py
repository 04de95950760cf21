"""Masks that TotalSegmentator wrote: the reference masks of its tests, which are not stored here.

WARP_TRUNK_TOTALSEGMENTATOR names the folder tests/reference_files of a clone of its repository (Apache-2.0).
"""

import os
from pathlib import Path

import pytest

from warp_trunk.cli import main

FOLDER = os.environ.get("WARP_TRUNK_TOTALSEGMENTATOR")
SIDES = ("left", "right")


@pytest.mark.skipif(FOLDER is None, reason="WARP_TRUNK_TOTALSEGMENTATOR names no folder of reference masks")
def test_a_crop_is_imported_as_far_as_it_reaches_and_what_is_missing_is_named(tmp_path, capsys):
    folder = Path(str(FOLDER))
    body = folder / "example_seg_fast_body_seg.nii.gz"
    out = tmp_path / "case"
    assert main(["import", str(folder / "example_seg.nii.gz"), "--body", str(body), "--out", str(out)]) == 3
    bones = {path.stem for path in (out / "bones").iterdir()}
    assert bones == {"T11", "T12", "L1", "L2", *(f"rib_{side}_{n:02d}" for side in SIDES for n in range(7, 13))}
    said = capsys.readouterr()
    assert "spleen, kidney_right" in said.out
    for part in (
        "Of the left ribs number 1, 2, 3, 4, 5, 6 has no label",
        "The image ends in L2, T11, T12, ",
        "asis_left: no landmarks: 'hip_left' is missing",
        "not yet a case that surgery can be planned on",
    ):
        assert part in said.err
    assert "not at T" not in said.err
    rows = (out / "landmarks_confidence.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows[1:]] == ["L1"]  # the one vertebra that is whole
