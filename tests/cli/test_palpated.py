"""A case without hip bones, whose iliac spines were palpated on the skin: planned, simulated and measured."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from support.phantoms import whole_phantom
from support.small_case import palpated
from warp_trunk.case import read_case, write_case
from warp_trunk.cli import main
from warp_trunk.geometry.coarsening import coarsen


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("palpated")
    whole = palpated(whole_phantom())
    case = dataclasses.replace(
        whole,
        skin=coarsen(whole.skin, 20.0, 1.0),
        bones={name: bone for name, bone in whole.bones.items() if not name.startswith("rib")},
        landmarks_after=None,
    )
    write_case(folder / "case", case)
    asked = ("--uiv", "T4", "--liv", "L1", "--curve", "T8,correction=0.6")
    assert main(["plan", str(folder / "case"), "--out", str(folder / "planned"), *asked]) == 0
    return folder / "planned"


def test_the_plan_leaves_the_iliac_spines_where_they_are(planned: Path) -> None:
    case = read_case(planned)
    assert not [name for name in case.bones if name.startswith("hip")]
    for name in ("asis_left", "asis_right"):
        np.testing.assert_array_equal(case.planned_landmarks.point(name), case.landmarks_before.point(name))


@pytest.mark.parametrize("bones", ["spline", "follow"])
def test_it_is_simulated_and_measured(planned: Path, tmp_path: Path, bones: str) -> None:
    options = (
        "--bones",
        bones,
        "--tets",
        "21000",
        "--bone-edge-length",
        "12",
        "--increments",
        "2",
        "--tolerance",
        "0.5",
        "--no-record",
    )
    assert main(["simulate", str(planned), "--out", str(tmp_path / "result"), *options, "--device", "cpu"]) == 0
    summary = json.loads((tmp_path / "result" / "summary.json").read_text())
    assert summary["status"] == "CONVERGED"
    measured = ("--case", str(planned), "--out", str(tmp_path / "measures"))
    assert main(["measure", str(tmp_path / "result"), *measured]) == 0
    assert json.loads((tmp_path / "measures.json").read_text())
