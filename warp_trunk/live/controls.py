"""The sliders of the page in all browsers, and where they stood before."""

import threading
import time
from collections.abc import Callable
from itertools import groupby
from typing import Any

import viser

from .sliders import Sliders, Wish, first_wish

PAUSE = 0.7
"""Sliders that rest for so long [s] have been released: undo returns to where they were then."""
MOST_UNDO = 100
"""Number of wishes that can be undone."""


class Controls:
    """Sliders and lists with undo. All browsers share them."""

    def __init__(self, gui: viser.GuiApi, sliders: Sliders, changed: Callable[[Wish], None]) -> None:
        """Adds the controls to the page.

        Args:
            gui: the page.
            sliders: what can be set.
            changed: called with each wish, from any thread.
        """
        self._sliders, self._changed = sliders, changed
        self._lock, self._setting = threading.RLock(), False
        self._wish, self._past, self._last = first_wish(sliders), list[Wish](), 0.0
        self._handles: dict[str, Any] = {}
        for folder, group in groupby(sliders.controls.items(), key=lambda item: item[1].folder):
            with gui.add_folder(folder):
                for name, control in group:
                    if control.choices:
                        handle = gui.add_dropdown(control.label, control.choices, initial_value=control.first)
                    else:
                        handle = gui.add_slider(control.label, *control.span, control.first, hint=control.hint)
                    handle.on_update(self._moved)
                    self._handles[name] = handle
        self._undo = gui.add_button("Undo", disabled=True)
        self._undo.on_click(lambda _: self.undo())
        self._enable()

    def undo(self) -> None:
        """Return to the previous resting position of the sliders."""
        with self._lock:
            if self._past:
                self._wish, self._last, self._setting = self._past.pop(), 0.0, True
                try:
                    for name, value in self._wish.items():
                        self._handles[name].value = value
                finally:
                    self._setting = False
                self._enable()
                self._changed(self._wish)

    def _moved(self, _: object) -> None:
        with self._lock:
            wish = {name: handle.value for name, handle in self._handles.items()}
            if self._setting or wish == self._wish:
                return
            now = time.monotonic()
            if now - self._last > PAUSE:
                self._past = [*self._past[1 - MOST_UNDO :], self._wish]
            self._wish, self._last = wish, now
            self._enable()
            self._changed(wish)

    def _enable(self) -> None:
        """Disable the controls that have no effect."""
        self._undo.disabled = not self._past
        unused = self._sliders.without_effect(self._wish)
        for name, handle in self._handles.items():
            handle.disabled = name in unused
