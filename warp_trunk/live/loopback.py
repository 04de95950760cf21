"""A server that only this machine reaches, and only its own page: viser as it is would answer anyone."""

import contextlib
import gzip
import http
import io
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
from typing import Any

import viser
import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from warp_trunk.errors import InputError
from warp_trunk.recording.viewer import LOOPBACK

POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; worker-src 'self' blob:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "connect-src 'self' data: blob:; frame-ancestors 'none'"
)
"""The browser loads from this server alone, connects to nothing else, and shows the page in no other."""
BUTTONS = (0, 90, 150)
"""Colour of buttons: white words on it have a contrast of 7:1."""
MOST_MESSAGE = 1_000_000
"""No browser has more to say at once [bytes]."""


class LoopbackServer(viser.ViserServer):
    """viser's server on the loopback device, for its own page alone, that never tunnels to the outside.

    A page of another site in the same browser reaches 127.0.0.1, too: what is not asked for by this page
    (`Origin`), or under another name (`Host`, as after rebinding of a name), gets 403, files and websockets alike.
    """

    def __init__(self, port: int, title: str) -> None:
        """Starts it.

        Args:
            port: where it listens.
            title: what stands over the controls.

        Raises:
            InputError: the port is taken.
        """
        check_port(port)
        with _guarded(port) as guards, contextlib.redirect_stdout(io.StringIO()):  # it prints a box
            super().__init__(host=LOOPBACK, port=port, label=title, verbose=False)
        if guards != [port] or self.get_port() != port:
            self.stop()
            raise InputError(f"--live: port {port} was taken by another program; give another --port")
        self.gui.configure_theme(show_share_button=False, show_logo=False)

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuses: what a browser asks for does not open this page to the outside."""
        return None

    @property
    def address(self) -> str:
        """The address to open in a browser."""
        return f"http://{LOOPBACK}:{self.get_port()}"


def check_port(port: int) -> None:
    """InputError where another program listens on a port, or the program of a user cannot."""
    if not 1024 <= port <= 65535:
        raise InputError(f"--port: must be from 1024 to 65535, not {port}; give 8137")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server does
        try:
            probe.bind((LOOPBACK, port))
        except OSError as error:
            raise InputError(
                f"--port: {port} cannot be listened on ({error.strerror}); close the program that has it, or give "
                "another"
            ) from None


def refusal(request: Request, port: int) -> Response | None:
    """The answer to a request that does not come from the page of a port; None if it does."""
    names = [f"{name}:{port}" for name in (LOOPBACK, "localhost")]
    hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
    if all(host in names for host in hosts) and all(
        origin in [f"http://{n}" for n in names] for origin in origins
    ):
        return None
    body = b"This page is only for the machine that it runs on.\n"
    headers = Headers({"Content-Type": "text/plain", "Content-Length": str(len(body)), "Connection": "close"})
    return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", headers, body)


def _complete(response: Response) -> None:
    """Adds to the page what viser leaves out: names of its controls, words dark enough, room on a phone."""
    packed = response.headers.get("Content-Encoding") == "gzip"
    page = gzip.decompress(response.body) if packed else response.body
    parts = {"page.css": b"style", "names.js": b"script", "phone.js": b"script"}
    texts = {name: files("warp_trunk.live").joinpath(name).read_bytes() for name in parts}
    added = b"".join(b"<%b>%b</%b>" % (kind, texts[name], kind) for name, kind in parts.items()) + b"</body>"
    before, end, after = page.rpartition(b"</body>")
    page = before + added + after if end else page
    response.body = gzip.compress(page, 1) if packed else page
    if "Content-Length" in response.headers:
        del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))


@contextmanager
def _guarded(port: int) -> Iterator[list[int]]:
    """While the block runs, servers are started with the guard; reports the port of each.

    viser has no place to hand one in. Should a later viser start its server another way, the list stays empty, and
    the page does not open.
    """
    server = websockets.asyncio.server
    serve, started = server.serve, []

    def guarded(handler: Any, host: str, at: int, *, process_request: Any, **options: Any) -> Any:
        def answer(connection: Any, request: Request) -> Response | None:
            response = refusal(request, at) or process_request(connection, request)
            if response is not None:
                response.headers["Content-Security-Policy"] = POLICY
                if response.headers.get("Content-Type", "").startswith("text/html"):
                    _complete(response)
            return response

        started.append(at)
        return serve(handler, host, at, process_request=answer, **{**options, "max_size": MOST_MESSAGE})

    server.serve = guarded  # type: ignore[assignment]  # put back below
    try:
        yield started
    finally:
        server.serve = serve
