"""The page answers this machine and itself, and rejects all others."""

import urllib.error
import urllib.request
from collections.abc import Iterator
from importlib.resources import files

import psutil
import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from warp_trunk.errors import InputError
from warp_trunk.live.loopback import LoopbackServer, check_port
from warp_trunk.recording.viewer import free_port

VERSION = Subprotocol(f"viser-v{viser.__version__}")


@pytest.fixture(scope="module")
def server() -> Iterator[LoopbackServer]:
    server = LoopbackServer(free_port(), "a patient")
    yield server
    server.stop()


def status(server: LoopbackServer, path: str = "/", **headers: str) -> int:
    """The answer to a request with these headers."""
    request = urllib.request.Request(server.address + path, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=10.0) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def test_its_own_page_is_answered_on_this_machine_alone(server: LoopbackServer) -> None:
    port = server.get_port()
    listening = [c for c in psutil.Process().net_connections("inet") if c.status == psutil.CONN_LISTEN]
    assert {c.laddr.ip for c in listening if c.laddr.port == port} == {"127.0.0.1"}
    with urllib.request.urlopen(server.address, timeout=10.0) as answer:
        policy = answer.headers["Content-Security-Policy"]
        page = answer.read().decode()
    assert "default-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "http" not in policy
    assert files("warp_trunk.live").joinpath("page.css").read_text(encoding="utf-8") in page  # viser leaves it out
    assert status(server) == 200
    assert status(server, Origin=server.address) == 200
    assert status(server, Host=f"localhost:{port}", Origin=f"http://localhost:{port}") == 200
    assert status(server, "/no-such-file") == 404
    with connect(f"ws://127.0.0.1:{port}", origin=Origin(server.address), subprotocols=[VERSION]) as socket:
        assert socket.recv(timeout=10.0)


@pytest.mark.parametrize(
    "origin", ["https://elsewhere.example", "http://127.0.0.1:1", "https://127.0.0.1", "null"]
)
def test_another_sites_page_is_refused(server: LoopbackServer, origin: str) -> None:
    assert status(server, Origin=origin) == 403
    with pytest.raises(InvalidStatus) as refused:
        connect(f"ws://127.0.0.1:{server.get_port()}", origin=Origin(origin), subprotocols=[VERSION]).close()
    assert refused.value.response.status_code == 403


def test_another_name_of_this_machine_is_refused(server: LoopbackServer) -> None:
    assert status(server, Host="rebound.example") == 403
    assert status(server, Host=f"rebound.example:{server.get_port()}") == 403


def test_it_is_not_shared(server: LoopbackServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """viser asks for a tunnel with a message of the browser, for which it needs no button."""
    monkeypatch.setattr("viser._viser.ViserTunnel", lambda *_: pytest.fail("it is tunnelled"))
    assert server.request_share_url() is None


def test_a_taken_port_is_refused_in_one_line(server: LoopbackServer) -> None:
    with pytest.raises(InputError, match=r"--port: \d+ cannot be listened on \(Address already in use\)"):
        LoopbackServer(server.get_port(), "another patient")
    with pytest.raises(InputError, match="cannot be listened on"):
        check_port(server.get_port())
