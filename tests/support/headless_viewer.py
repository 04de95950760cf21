"""Rerun's native viewer without a window, for tests that look at what a reader will see."""

import io
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from warp_trunk.recording import viewer

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
