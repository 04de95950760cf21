"""warp-trunk plan: a case and an intention make a case that can be simulated; --live serves a page."""

import dataclasses
import json
import re
import signal
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import warp_trunk.live.opening as opening
from support.asserting import forbid_meshing
from support.phantoms import whole_phantom
from support.small_case import palpated
from support.small_trunk import curved_case, small_patient
from warp_trunk.bone_motion.plan import lenke_of, read_plan
from warp_trunk.case import read_case, write_case
from warp_trunk.case.anatomy import PELVIC_RING
from warp_trunk.cli import main
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.recording.viewer import free_port
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.progress import Progress

TEXT = """\
uiv = "T4"
liv = "L1"
[[curve]]
apex = "T8"
correction = 0.65
derotation = 0.4
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case without a plan, and plan.toml beside it."""
    folder = tmp_path_factory.mktemp("plan")
    write_case(folder / "case", dataclasses.replace(whole_phantom(), landmarks_after=None))
    (folder / "plan.toml").write_text(TEXT, encoding="utf-8")
    return folder


def plan(folder: Path, out: str, *options: str) -> int:
    return main(["plan", str(folder / "case"), "--out", str(folder / out), *options])


def test_planned_folder_is_a_case_that_holds_its_plan(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert plan(folder, "planned", "--plan", str(folder / "plan.toml")) == 0
    said = capsys.readouterr().out
    planned = read_case(folder / "planned")
    assert planned.landmarks_after is not None
    record = json.loads((folder / "planned" / "plan.json").read_text(encoding="utf-8"))
    assert [vertebra["level"] for vertebra in record["vertebrae"]] == list(planned.landmarks_before.vertebrae())
    t8 = next(vertebra for vertebra in record["vertebrae"] if vertebra["level"] == "T8")
    centres = [
        marks.of_bone("T8").points.mean(axis=0) for marks in (planned.landmarks_before, planned.landmarks_after)
    ]
    np.testing.assert_allclose(t8["shift"], centres[1] - centres[0], atol=1e-9)
    assert re.search(r"Cobb angle T5 to T12 \[°\] +55 +19 ", said)
    assert f"warp-trunk simulate {folder / 'planned'}" in said
    assert said.splitlines()[0] == f"Curve type: Lenke {lenke_of(planned)}"
    assert lenke_of(planned).startswith("1")  # a main thoracic curve


def test_an_older_plan_is_replaced_with_a_warning(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    warned = "its older plan is replaced"
    for liv, expected in (("L1", False), ("L1", False), ("L2", True)):
        assert plan(folder, "older", "--uiv", "T4", "--liv", liv, "--curve", "T8,correction=0.65") == 0
        output = capsys.readouterr()
        assert (warned in output.out + output.err) == expected, liv
    assert 'liv = "L2"' in (folder / "older" / "plan.toml").read_text(encoding="utf-8")


def test_plan_that_was_written_makes_it_again(folder: Path) -> None:
    options = ("--uiv", "T3", "--liv", "L2", "--curve", "T8,cobb_after=25", "--kyphosis-T5-T12", "30")
    assert plan(folder, "first", *options) == 0
    assert plan(folder, "again", "--plan", str(folder / "first" / "plan.toml")) == 0
    first, again = (read_case(folder / name).planned_landmarks for name in ("first", "again"))
    np.testing.assert_array_equal(again.points, first.points)


def test_option_takes_the_place_of_what_the_file_says(folder: Path) -> None:
    assert plan(folder, "other", "--plan", str(folder / "plan.toml"), "--liv", "L2") == 0
    written = read_plan(folder / "other" / "plan.toml")
    assert (written.uiv, written.liv, written.curves[0].correction) == ("T4", "L2", 0.65)


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        (("--uiv", "T4"), "the curves are 24 degrees T1 to T5 with apex T3, 55 degrees T5 to T12"),
        (("--uiv", "T4", "--liv", "L1", "--curve", "T8,correctoin=0.5"), "did you mean 'correction'?"),
        (
            ("--uiv", "T4", "--liv", "L1", "--curve", "T8,correction=0.5,correction=0.6"),
            "is given twice; give it once",
        ),
        (("--plan", "PLAN", "--aim", "hump"), "--aim and --within belong together"),
        (
            ("--plan", "PLAN", "--aim", "bsr", "--within", "T8,correction=0.5"),
            "two numbers, as correction=0.5..0.8",
        ),
    ],
)
def test_what_is_wrong_is_said_in_one_line(folder, refused, options, rule):
    words = [folder / "plan.toml" if option == "PLAN" else option for option in options]
    refused(["plan", folder / "case", "--out", folder / "refused", *words], rule)
    assert not (folder / "refused").exists()


def test_a_case_without_a_pelvis_is_refused(tmp_path: Path, refused) -> None:
    whole = palpated(whole_phantom())
    bones = {name: bone for name, bone in whole.bones.items() if name not in PELVIC_RING}
    write_case(tmp_path / "case", dataclasses.replace(whole, bones=bones, landmarks_after=None))
    asked = ["--uiv", "T4", "--liv", "L1", "--curve", "T8,correction=0.6"]
    command = ["plan", str(tmp_path / "case"), "--out", str(tmp_path / "planned"), *asked]
    assert "has no bone of the pelvis" in refused(command)
    assert not (tmp_path / "planned").exists()


def test_case_is_not_overwritten(folder, refused):
    words = ["plan", folder / "case", "--out", folder / "case", "--plan", folder / "plan.toml"]
    refused(words, "is the case itself")
    assert read_case(folder / "case").landmarks_after is None


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
    assert json.loads((tmp_path / "measures.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("live") / "anna"
    write_case(folder, replace(whole_phantom(), landmarks_after=None))
    return folder


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        (("--live", "--predict"), "--live: predicts while you plan; leave --predict out"),
        (("--uiv", "T4", "--liv", "L1"), "plan: --out is missing; give the case folder to write, or --live"),
        (("--live", "--port", "0"), "--port: must be from 1024 to 65535, not 0"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(case, refused, monkeypatch, options, rule):
    forbid_meshing(monkeypatch)
    refused(["plan", case, *options], rule)


def test_the_extra_is_named_where_it_is_missing(case, refused, monkeypatch):
    monkeypatch.setattr(opening, "find_spec", lambda name: None if name == "viser" else name)
    refused(["plan", case, "--live"], "not installed (viser); pip install 'warp-trunk[live]'")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_and_names_what_was_kept(tmp_path, monkeypatch, capsys, number):
    monkeypatch.setattr(opening, "patient_of", lambda *_, **__: small_patient())
    inherited = signal.signal(number, signal.default_int_handler)  # a job in the background ignores SIGINT
    before = signal.getsignal(number)

    class Opened(Progress):
        def message(self, text: str) -> None:
            super().message(text)
            if text.startswith("Plan at"):
                threading.Timer(0.2, signal.raise_signal, (number,)).start()

    ended = opening.plan_live(
        curved_case(), tmp_path, RunOptions(), Execution(device="cpu"), Opened(), port=free_port()
    )
    assert ended is None
    assert signal.signal(number, inherited) is before
    assert "Plan at http://127.0.0.1:" in capsys.readouterr().err
