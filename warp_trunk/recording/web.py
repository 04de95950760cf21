"""The web viewer, served to this machine only.

Rerun's own page asks for a font and sends statistics to servers elsewhere. Here the page and what it loads come
from one small server on the loopback address, with a policy that lets the browser connect to nothing else.
"""

from __future__ import annotations

import subprocess
import urllib.request
import webbrowser
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from warp_trunk.errors import InputError

from .viewer import LOOPBACK, free_port, listening, stop, viewer_command, viewer_environment

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
    with page_server(recording) as server:
        url = address(server)
        print(f"serving {recording} at {url} (Ctrl-C ends)", flush=True)
        webbrowser.open(url)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            return 0
    return 0


def address(server: ThreadingHTTPServer) -> str:
    """Where the page shows the recording."""
    here = f"http://{LOOPBACK}:{server.server_port}"
    return f"{here}/?url={here}/recording.rrd&hide_welcome_screen=1"


def page_server(recording: Path) -> ThreadingHTTPServer:
    """A server on a free port of the loopback address, not yet running.

    Raises:
        InputError: Rerun's page cannot be had.
    """
    parts = _page()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            path = self.path.partition("?")[0]
            if path == "/recording.rrd":
                self._answer(recording.read_bytes(), "application/octet-stream")
            elif path in parts:
                self._answer(parts[path], PAGE[path])
            else:
                self.send_error(404)

        def _answer(self, body: bytes, kind: str) -> None:
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Content-Security-Policy", POLICY)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Logs nothing: a line for each part of the page is no help."""

    return ThreadingHTTPServer((LOOPBACK, 0), Handler)


def _page() -> dict[str, bytes]:
    """The parts of Rerun's page, from its own server, which is stopped again."""
    port, unused = free_port(), free_port()
    process = subprocess.Popen(
        viewer_command("--serve-web", "--web-viewer-port", str(port), "--port", str(unused)),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=viewer_environment(),
        start_new_session=True,
    )
    try:
        if not listening(process, port):
            raise InputError("--web: the web viewer cannot be served; open the result without --web")
        parts = {}
        for path in PAGE:
            with urllib.request.urlopen(f"http://{LOOPBACK}:{port}{path}", timeout=30.0) as answer:
                parts[path] = answer.read()
        return parts
    finally:
        stop(process)
