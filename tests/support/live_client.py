"""A client of the planning page without a browser: it moves a slider, sees when the skin follows, keeps plans."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec
import viser
import zstandard
from viser import _messages as messages
from websockets.sync.client import connect

SLIDER, KEEP, SKIN, RELAXED = "Correction %", "Keep this plan", "/skin", "Relaxed skin"
"""Labels of slider and button, the name of the skin, and the status of one that is relaxed."""
_LONGEST = 300.0
"""An answer takes no longer [s]."""


class Client:
    """One connection to a page, in the protocol of its own browser client (viser)."""

    def __init__(self, address: str) -> None:
        """Connects to the page at an address and finds the first slider that corrects a curve of the fusion."""
        self._wire = connect(
            address.replace("http", "ws", 1),
            origin=address,  # type: ignore[arg-type]  # a NewType of str
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]  # likewise
            max_size=None,
        )
        away = {"fov": 0.6, "near": 1.0, "far": 9e3, "image_height": 600, "image_width": 1000}
        turn, origin, up = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
        self._send(
            messages.ViewerCameraMessage(
                wxyz=turn, position=(0.0, 1e3, 0.0), look_at=origin, up_direction=up, **away
            )
        )
        found: dict[str, str] = {}
        for message in self._received():
            kind, props = message["type"], message.get("props") or {}
            if kind == "GuiSliderMessage" and props["label"] == SLIDER and not props["disabled"]:
                found.setdefault("slider", message["uuid"])
            if kind == "GuiHtmlMessage":
                found.setdefault("status", message["uuid"])
            if kind == "GuiButtonMessage" and props["label"] == KEEP:
                found["keep"] = message["uuid"]
            if len(found) == 3:
                break
        self._slider, self._status, self._keep = found["slider"], found["status"], found["keep"]

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self._wire.close()

    def move(self, value: int) -> None:
        """Moves the slider and waits for new vertices of the skin, then for relaxed ones."""
        moved = False
        self._send(messages.GuiUpdateMessage(self._slider, {"value": value}))
        for message in self._received():
            updates = message.get("updates") or {}
            moved |= (
                message["type"] == "SceneNodeUpdateMessage" and "vertices" in updates and message["name"] == SKIN
            )
            if moved and message.get("uuid") == self._status and RELAXED in updates.get("content", ""):
                return

    def keep(self) -> None:
        """Presses the button that keeps the plan; what comes of it is not waited for."""
        self._send(messages.GuiUpdateMessage(self._keep, {"value": True}))

    def wait_for(self, text: str) -> None:
        """Waits until the page says something."""
        for message in self._received():
            if text in str((message.get("updates") or {}).get("content", "")):
                return

    def _send(self, message: messages.Message) -> None:
        self._wire.send(msgspec.msgpack.encode(message.as_serializable_dict()))

    def _received(self) -> Iterator[dict[str, Any]]:
        """Messages one after another, without the arrays that follow them."""
        while True:
            frame = self._wire.recv(timeout=_LONGEST)
            if not isinstance(frame, bytes):
                raise TypeError("the page sent text")
            size = int.from_bytes(frame[8:16], "little")
            yield from msgspec.msgpack.decode(zstandard.decompress(frame[16 : 16 + size]))["messages"]
