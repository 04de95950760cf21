"""The viewer of Rerun, as a program and in the browser."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warp_trunk.case.folders import other_kind
from warp_trunk.checking import checked
from warp_trunk.errors import InputError, MissingFileError
from warp_trunk.io.atomic_write import partial
from warp_trunk.io.result_files import RECORDING, SUMMARY
from warp_trunk.results import Result
from warp_trunk.system import start_apart

if TYPE_CHECKING:
    from http.server import ThreadingHTTPServer


LOOPBACK = "127.0.0.1"
WAIT = 60.0
"""Longest wait for a viewer to open [s]."""
WITHOUT_DISPLAY = "use `view --web`, or copy the result folder to a machine with a screen and `view` it there"
"""The advice if there is no display."""


@checked
def view_result(result: Result | str | Path, *, web: bool = False) -> int:
    """Open the recording of a result, and wait for its end.

    >>> wt.view_result(result.save(folder / "seen"))  # of wt.simulate without a recording
    Traceback (most recent call last):
    warp_trunk.errors.InputError: seen: holds no recording.rrd; give a folder that was simulated with --record

    Args:
        result: a saved result, a result folder, also one whose simulation was cut short, or a recording.
        web: open it in a browser on this machine instead of a window.

    Returns:
        The exit status of the viewer.

    Raises:
        InputError: the result is not saved, there is no recording, the file is none, or there is no display.
    """
    return (view_in_browser if web else view)(
        find_recording(result.folder if isinstance(result, Result) else Path(result))
    )


def find_recording(result: Path) -> Path:
    """The recording in a result folder, also one that was cut short, or a recording itself.

    Raises:
        InputError: there is no recording, or the file is none.
    """
    if result.is_file():
        with result.open("rb") as file:
            if file.read(3) != b"RRF":  # how a recording begins; Rerun's viewer would open many other files
                raise InputError(f"{result}: is no recording; give a result folder or the {RECORDING} in it")
        return result
    for path in (result / RECORDING, partial(result / RECORDING)):
        if path.is_file():
            return path
    if not result.exists():
        raise MissingFileError(f"{result}: there is no such folder or file; give a result folder or a recording")
    cure = other_kind(result, "result") if not (result / SUMMARY).exists() else ""
    cure = cure or "give a folder that was simulated with --record"
    raise InputError(f"{result}: holds no {RECORDING}; {cure}")


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
        process = _started("--port", str(port), "--expect-data-soon", *options, output=output)
        if not listens(process, port):
            stop(process)
            output.seek(0)
            words = output.read().decode(errors="replace").strip().splitlines() or ["no reason given"]
            raise InputError(
                f"--view: the viewer does not open ({words[-1]}); leave --view out and open the result with `view`"
            )
    return f"rerun+http://{LOOPBACK}:{port}/proxy"


def viewer_command(*arguments: str) -> list[str]:
    """The command line of a viewer that other machines cannot reach."""
    return [sys.executable, "-m", "rerun", "--bind", LOOPBACK, *arguments]


def viewer_environment() -> dict[str, str]:
    """The environment in which Rerun sends no statistics of its use: it sends none in continuous integration."""
    return {**os.environ, "CI": "1"}


def _started(*arguments: str, output: Any = subprocess.DEVNULL) -> subprocess.Popen[bytes]:
    """A viewer that outlives this program."""
    return start_apart(viewer_command(*arguments), viewer_environment(), output)


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


def listens(process: subprocess.Popen[bytes], port: int) -> bool:
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


PAGE = {
    "/": "text/html; charset=utf-8",
    "/re_viewer.js": "text/javascript",
    "/re_viewer_bg.wasm": "application/wasm",
    "/favicon.ico": "image/x-icon",
}
"""The parts of the page and their types."""
POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; worker-src 'self' blob:; "
    "style-src 'unsafe-inline'; img-src 'self' data: blob:; connect-src 'self'"
)
"""The browser loads and connects to this server alone."""


def view_in_browser(recording: Path) -> int:
    """Serves the web viewer with a recording and opens a browser; ends with Ctrl-C. Returns an exit status.

    Raises:
        InputError: Rerun's page cannot be had.
    """
    import webbrowser

    with page_server(recording) as server:
        url = address(server)
        print(f"serving {recording} at {url} (Ctrl-C ends)", flush=True)
        webbrowser.open(url)
        with contextlib.suppress(KeyboardInterrupt):
            server.serve_forever()
    return 0


def address(server: ThreadingHTTPServer) -> str:
    """Where the page shows the recording."""
    server_address = f"http://{LOOPBACK}:{server.server_port}"
    return f"{server_address}/?url={server_address}/recording.rrd&hide_welcome_screen=1"


def page_server(recording: Path) -> ThreadingHTTPServer:
    """A server on a free port of the loopback address, not yet running.

    Raises:
        InputError: Rerun's page cannot be had.
    """
    from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer  # heavy

    parts = _page()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            path = self.path.partition("?")[0]
            kind = PAGE.get(path, "application/octet-stream")
            body = recording.read_bytes() if path == "/recording.rrd" else parts.get(path)
            if body is None:
                self.send_error(404)
                return
            self.send_response(200)
            headers = {"Content-Type": kind, "Content-Length": len(body), "Content-Security-Policy": POLICY}
            for name, value in headers.items():
                self.send_header(name, str(value))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Logs nothing: a line for each part of the page is no help."""

    return ThreadingHTTPServer((LOOPBACK, 0), Handler)


def _page() -> dict[str, bytes]:
    """The parts of Rerun's page, from its own server, which is stopped again."""
    from urllib.request import urlopen  # heavy

    port, unused = free_port(), free_port()
    process = _started("--serve-web", "--web-viewer-port", str(port), "--port", str(unused))
    try:
        if not listens(process, port):
            raise InputError("--web: the web viewer cannot be served; open the result without --web")
        root = f"http://{LOOPBACK}:{port}"
        return {path: urlopen(f"{root}{path}", timeout=30.0).read() for path in PAGE}
    finally:
        stop(process)
