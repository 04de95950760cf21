"""The viewer itself: what it shows of a recording, live and in a browser, and who can reach it."""

import io
import os
import re
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np
import pytest

from support.rrd import column
from support.small_trunk import made_up_increments, measured, small_case, start_recording
from warp_trunk.errors import InputError
from warp_trunk.recording import start_viewer, viewer
from warp_trunk.recording.colours import LABEL_BOX
from warp_trunk.recording.viewer import POLICY, address, free_port, listens, page_server, stop

DRIVERS = [Path(folder) / "vulkan/icd.d" for folder in ("/usr/share", "/usr/local/share", "/etc")]
needs_vulkan = pytest.mark.skipif(
    not any(folder.is_dir() and any(folder.iterdir()) for folder in DRIVERS),
    reason="no Vulkan driver for the viewer (Debian has one in mesa-vulkan-drivers)",
)


@contextmanager
def headless_viewer(recording: Path, size: str = "1600x900") -> Iterator:
    """A viewer that has a recording open, as a client to ask; it is gone at the end, whatever happens."""
    from rerun.experimental import ViewerClient

    port = viewer.free_port()
    process = subprocess.Popen(
        viewer.viewer_command("--headless", "--port", str(port), "--window-size", size, str(recording)),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=viewer.viewer_environment(),
        start_new_session=True,
    )
    try:
        assert viewer.listens(process, port)
        client = ViewerClient(f"rerun+http://127.0.0.1:{port}/proxy")
        until(lambda: client.get_state().recordings and not client.get_state().loading)
        yield client
    finally:
        viewer.stop(process)


def until(reached, seconds: float = 30.0) -> None:
    """Waits for something to be true."""
    end = time.monotonic() + seconds
    while not reached():
        assert time.monotonic() < end
        time.sleep(0.05)


def picture(client, increment: int) -> np.ndarray:
    """Image of the viewer at an increment, (height, width, 3), uint8, once it no longer changes."""
    from PIL import Image

    client.set_time("increment", sequence=increment, play_state="paused")
    shots = [b"", client.take_screenshot()]
    while shots[-1] != shots[-2]:
        assert len(shots) < 50
        time.sleep(0.2)
        shots.append(client.take_screenshot())
    return np.asarray(Image.open(io.BytesIO(shots[-1])).convert("RGB"))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A whole recording."""
    case, trunk = small_case()
    path = tmp_path_factory.mktemp("viewer") / "recording.rrd"
    with start_recording(path, case, trunk) as recording:
        for increment in made_up_increments(trunk):
            recording.increment(increment, measured(case, trunk, increment))
        recording.finish("# The end")
    return path


@needs_vulkan
@pytest.mark.slow
def test_the_viewer_shows_every_view_without_an_error(recorded):
    with headless_viewer(recorded) as client:
        first, last = picture(client, 0), picture(client, 3)
        state, log = client.get_state(), client.get_logs()
    (opened,) = state.recordings
    assert [(t.name, t.start, t.end) for t in opened.timelines if t.name == "increment"] == [("increment", 0, 3)]
    assert {"Before", "Now", "The spine now", "Summary"} <= {view.name for view in state.views}
    assert [(view.name, view.reports) for view in state.views if view.reports] == []
    words = [entry.message for entry in log if entry.level != "INFO" and "rasterizer" not in entry.message]
    assert words == []
    for left in (5, 380, 755):  # each pane holds a body on an even ground
        pane = last[120:420, left : left + 360]
        ground = pane[0, 0].astype(int)
        assert 0.1 < (np.abs(pane.astype(int) - ground).max(axis=2) > 30).mean() < 0.9
    still, moved = (
        np.abs(last[120:440, columns].astype(int) - first[120:440, columns]).mean()
        for columns in (slice(0, 360), slice(385, 730))
    )
    assert still == 0.0  # before
    assert moved > 5.0  # now


@needs_vulkan
@pytest.mark.slow
def test_the_box_behind_a_label_is_the_one_its_colours_were_chosen_for(recorded):
    with headless_viewer(recorded) as client:
        last = picture(client, 3)
    box = (last == LABEL_BOX).all(axis=2)
    assert box.mean() > 0.005  # labels of sides, scale, section and bars


@needs_vulkan
@pytest.mark.slow
def test_live_shows_it_and_a_viewer_that_is_closed_takes_nothing_from_the_file(tmp_path, monkeypatch):
    from rerun.experimental import ViewerClient

    started = []
    popen = subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", lambda *a, **k: started.append(popen(*a, **k)) or started[-1])
    case, trunk = small_case()
    try:
        url = start_viewer("--headless")
        (process,) = started
        client = ViewerClient(url)
        path = tmp_path / "recording.rrd"
        with start_recording(path, case, trunk, live=url) as recording:
            for increment in made_up_increments(trunk, count=4):
                if increment.number == 3:
                    until(
                        lambda: (
                            [t.end for t in client.get_state().recordings[0].timelines if t.name == "increment"]
                            == [2]
                        )
                    )
                    stop(process)
                recording.increment(increment, measured(case, trunk, increment))
    finally:
        for process in started:
            stop(process)
    assert not recording.failed
    assert sorted(column(path, "/now/skin", "vertex_positions")) == [0, 1, 2, 3, 4]


def answered(recording: Path, *paths: str) -> dict[str, tuple[int, str, str, bytes]]:
    """Status, type, policy and body of the answers of the page that shows a recording."""
    answers = {}
    with page_server(recording) as server:
        assert server.server_address[0] == "127.0.0.1"
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        root = f"http://127.0.0.1:{server.server_port}"
        assert address(server) == f"{root}/?url={root}/recording.rrd&hide_welcome_screen=1"
        try:
            for path in paths:
                try:
                    with urllib.request.urlopen(root + path) as answer:
                        head = (answer.headers["Content-Type"], answer.headers["Content-Security-Policy"])
                        answers[path] = (answer.status, *head, answer.read())
                except urllib.error.HTTPError as error:
                    answers[path] = (error.code, "", "", b"")
        finally:
            server.shutdown()
            thread.join()
    return answers


def test_the_page_has_its_parts_and_the_recording_and_reaches_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.rrd").write_bytes(b"RRF2...")
    monkeypatch.setattr(viewer, "_page", lambda: {"/": b"<html>", "/re_viewer.js": b"js"})
    assert answered(tmp_path / "a.rrd", "/", "/?a=b", "/re_viewer.js", "/recording.rrd", "/../secret") == {
        "/": (200, "text/html; charset=utf-8", POLICY, b"<html>"),
        "/?a=b": (200, "text/html; charset=utf-8", POLICY, b"<html>"),
        "/re_viewer.js": (200, "text/javascript", POLICY, b"js"),
        "/recording.rrd": (200, "application/octet-stream", POLICY, b"RRF2..."),
        "/../secret": (404, "", "", b""),
    }
    assert "connect-src 'self'" in POLICY
    assert "http" not in POLICY


@pytest.mark.slow
def test_the_page_is_that_of_rerun(recorded: Path) -> None:
    answers = answered(recorded, "/", "/re_viewer_bg.wasm", "/recording.rrd")
    for body, expected in zip(answers.values(), (b"<html", b"\0asm", b"RRF2"), strict=True):
        assert expected in body[3][:500]


def test_a_viewer_that_does_not_open_is_ended_and_its_last_words_are_passed_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    code, started = "print('no\\ndisplay', flush=True); import time; time.sleep(600)", list[subprocess.Popen]()

    def begun(*_: str, output: IO[bytes]) -> subprocess.Popen:
        started.append(subprocess.Popen([sys.executable, "-c", code], stdout=output))
        until(lambda: os.fstat(output.fileno()).st_size > 0)
        return started[-1]

    monkeypatch.setattr(viewer, "_started", begun)
    monkeypatch.setattr(viewer, "listens", lambda *_: len(started) == 2)
    with pytest.raises(InputError, match=r"the viewer does not open \(display\); leave --view out"):
        start_viewer()
    assert started[0].poll() not in (None, 0)
    assert re.fullmatch(r"rerun\+http://127\.0\.0\.1:\d+/proxy", start_viewer())
    stop(started[1])


def test_a_program_listens_while_it_runs_and_is_stopped_with_what_it_started() -> None:
    port = free_port()
    running = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    with socket.create_server(("127.0.0.1", port)):
        assert listens(running, port)
    stop(running)
    assert running.poll() not in (None, 0)
    assert not listens(running, free_port())
    stop(running)  # again: nothing happens
