"""warp-trunk plan: a case without hip bones, and the end of the planning page."""

import dataclasses
import json
import signal
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import warp_trunk.live.opening as opening
from support.asserting import refuses
from support.phantoms import whole_phantom
from support.small_case import palpated
from support.small_trunk import curved_case, small_patient
from warp_trunk.case import read_case, write_case
from warp_trunk.cli import main
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.recording.viewer import free_port
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.progress import Progress

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


def test_the_plans_that_were_kept_are_named_at_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One of two was there before."""

    class Ended:
        stopped, server, failure = threading.Event(), SimpleNamespace(address="http://here"), "out of memory"
        saved = SimpleNamespace(views={"old": None, "new": None}, earlier={"old": None})

        def __init__(self, *_: object) -> None:
            self.stopped.set()

        def __enter__(self) -> "Ended":
            return self

        def __exit__(self, *_: object) -> None:
            pass

    class Heard(Progress):
        def message(self, text: str) -> None:
            messages.append(text)

    messages: list[str] = []
    monkeypatch.setattr(opening, "patient_of", lambda *_, **__: SimpleNamespace(relaxer=None))
    monkeypatch.setattr("warp_trunk.live.planning_page.Page", Ended)
    failure = opening.plan_live(curved_case(), tmp_path, RunOptions(), Execution(), Heard(), port=free_port())
    assert failure == "out of memory"
    assert messages == [
        "Plan at http://here on this machine; Ctrl-C or its button ends it", f"Kept: {tmp_path / 'new'}",
    ]  # fmt: skip


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
    with refuses("--port: must be from 1024 to 65535, not 80; give 8137"):
        opening.plan_live(curved_case(), tmp_path, RunOptions(), Execution(device="cpu"), Opened(), port=80)
    assert signal.signal(number, inherited) is before
    assert "Plan at http://127.0.0.1:" in capsys.readouterr().err
