"""A case without hip bones, whose iliac spines were palpated on the skin: planned, simulated and measured."""

import dataclasses
import json
from pathlib import Path

import numpy as np

from support.phantoms import whole_phantom
from support.small_case import palpated
from warp_trunk.case import read_case, write_case
from warp_trunk.cli import main
from warp_trunk.geometry.coarsening import coarsen

QUICK = "--tets 21000 --bone-edge-length 12 --increments 2 --tolerance 0.5 --no-record --device cpu"


def test_a_case_without_hip_bones_is_planned_simulated_and_measured(tmp_path: Path) -> None:
    whole = palpated(whole_phantom())
    bones = {name: bone for name, bone in whole.bones.items() if not name.startswith("rib")}
    case = dataclasses.replace(whole, skin=coarsen(whole.skin, 20.0, 1.0), bones=bones, landmarks_after=None)
    write_case(tmp_path / "case", case)
    asked = ["--uiv", "T4", "--liv", "L1", "--curve", "T8,correction=0.6"]
    assert main(["plan", str(tmp_path / "case"), "--out", str(tmp_path / "planned"), *asked]) == 0
    planned = read_case(tmp_path / "planned")
    assert not [name for name in planned.bones if name.startswith("hip")]
    for name in ("asis_left", "asis_right"):
        np.testing.assert_array_equal(planned.planned_landmarks.point(name), planned.landmarks_before.point(name))
    assert main(["simulate", str(tmp_path / "planned"), "--out", str(tmp_path / "result"), *QUICK.split()]) == 0
    assert main(["measure", str(tmp_path / "result"), "--out", str(tmp_path / "measures")]) == 0
    assert json.loads((tmp_path / "measures.json").read_text())
