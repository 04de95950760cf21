"""warp-trunk plan --live: refused in one line, or open until it is ended."""

import signal
import threading
from dataclasses import replace
from pathlib import Path

import pytest

import warp_trunk.live.opening as opening
from support.asserting import forbid_meshing
from support.phantoms import whole_phantom
from support.small_trunk import curved_case, small_patient
from warp_trunk.case import write_case
from warp_trunk.recording.viewer import free_port
from warp_trunk.run.options import RunOptions
from warp_trunk.run.progress import Progress


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

    ended = opening.plan_live(curved_case(), tmp_path, RunOptions(device="cpu"), Opened(), port=free_port())
    assert ended is None
    assert signal.signal(number, inherited) is before
    assert "Plan at http://127.0.0.1:" in capsys.readouterr().err
