"""Starting the viewer: on this machine, for this machine only, without any connection to others."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from warp_trunk.errors import InputError

LOOPBACK = "127.0.0.1"
WAIT = 60.0
"""Longest wait for a viewer to open [s]."""
WITHOUT_DISPLAY = "use `view --web`, or copy the result folder to a machine with a screen and `view` it there"
"""The advice if there is no display."""


def view(recording: Path) -> int:
    """Opens a recording in the native viewer and waits for its end; returns its exit status.

    Raises:
        InputError: there is no display.
    """
    if not has_display():
        raise InputError(f"view: there is no display for the viewer's window; {WITHOUT_DISPLAY}")
    return subprocess.run(viewer_command(str(recording)), env=viewer_environment(), check=False).returncode


def has_display() -> bool:
    """Whether a window can open on this machine."""
    return any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"))


def start_viewer(*options: str) -> str:
    """Starts a native viewer that outlives this process, and returns the URL to which to send a recording.

    Args:
        options: further ones of the viewer, such as --headless.

    Raises:
        InputError: it does not open; a display is missing, most often.
    """
    port = free_port()
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(
            viewer_command("--port", str(port), "--expect-data-soon", *options),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            env=viewer_environment(),
            start_new_session=True,
        )
        if not listening(process, port):
            stop(process)
            output.seek(0)
            words = output.read().decode(errors="replace").strip().splitlines() or ["no reason given"]
            raise InputError(
                f"--live: the viewer does not open ({words[-1]}); leave --live out and open the result with `view`"
            )
    return f"rerun+http://{LOOPBACK}:{port}/proxy"


def viewer_command(*arguments: str) -> list[str]:
    """The command line of a viewer that other machines cannot reach."""
    return [sys.executable, "-m", "rerun", "--bind", LOOPBACK, *arguments]


def viewer_environment() -> dict[str, str]:
    """The environment in which Rerun sends no statistics of its use: it sends none in continuous integration."""
    return {**os.environ, "CI": "1"}


def stop(process: subprocess.Popen[bytes]) -> None:
    """Ends a viewer: the process that was started, and the one that it started itself."""
    import psutil

    if process.poll() is None:
        for child in psutil.Process(process.pid).children(recursive=True):
            child.kill()
        process.kill()
    process.wait()


def free_port() -> int:
    """A port that is free."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return probe.getsockname()[1]


def listening(process: subprocess.Popen[bytes], port: int) -> bool:
    """Whether the process listens on the port, waiting until it does or ends."""
    end = time.monotonic() + WAIT
    while process.poll() is None and time.monotonic() < end:
        try:
            socket.create_connection((LOOPBACK, port), timeout=1.0).close()
        except OSError:
            time.sleep(0.05)
        else:
            return True
    return False
