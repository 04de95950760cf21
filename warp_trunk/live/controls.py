"""The sliders and buttons of the page, and where they stood before."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .wish import Spine, Wish

if TYPE_CHECKING:
    import viser

PAUSE = 0.7
"""Sliders that rest for so long [s] have been let go: undo goes back to where they were then."""
MOST_UNDO = 100
"""So many wishes can be undone."""
KYPHOSIS = (0, 90)
"""What a plan may ask for [degrees]."""


@dataclass(frozen=True)
class _Sliders:
    """One curve's."""

    correction: viser.GuiSliderHandle[int]
    derotation: viser.GuiSliderHandle[int]


class WishControls:
    """Sliders for every curve, kyphosis and the ends of the fusion. All browsers share them."""

    def __init__(self, gui: viser.GuiApi, spine: Spine, wish: Wish, changed: Callable[[Wish], None]) -> None:
        """Adds them to the page.

        Args:
            gui: where to.
            spine: what is known before surgery.
            wish: where they stand first.
            changed: told of each wish, from any thread.
        """
        self._changed, self._spine = changed, spine
        self._lock = threading.RLock()
        self._setting = False
        self._wish, self._past, self._last = wish, [], 0.0
        with gui.add_folder("Fusion"):
            self._uiv = gui.add_dropdown("Upper vertebra", spine.levels, initial_value=wish.uiv)
            self._liv = gui.add_dropdown("Lower vertebra", spine.levels, initial_value=wish.liv)
        self._curves: dict[str, _Sliders] = {}
        for curve in spine.curves:
            title = f"Curve {curve.upper}-{curve.lower}, {curve.convex}, {curve.angle:.0f}°"
            with gui.add_folder(title):
                hint = "Share of the Cobb angle that surgery takes away"
                turn = f"Share of the axial rotation of {curve.apex} that surgery takes away"
                self._curves[curve.apex] = _Sliders(
                    gui.add_slider("Correction %", 0, 100, 1, wish.correction[curve.apex], hint=hint),
                    gui.add_slider("Derotation %", 0, 100, 1, wish.derotation[curve.apex], hint=turn),
                )
        self._kyphosis = None
        if spine.kyphosis is not None:
            self._still = min(max(round(spine.kyphosis), KYPHOSIS[0]), KYPHOSIS[1])
            stands = self._still if wish.kyphosis is None else wish.kyphosis
            with gui.add_folder("Kyphosis"):
                hint = f"Before surgery {spine.kyphosis:.0f}°, which is kept where the slider stands there"
                self._kyphosis = gui.add_slider("T5-T12 °", *KYPHOSIS, 1, stands, hint=hint)
        for handle in self._handles():
            handle.on_update(self._moved)
        self._undo = gui.add_button("Undo", disabled=True)
        self._undo.on_click(lambda _: self.undo())
        self._enable()

    def undo(self) -> None:
        """Goes back to where the sliders rested before."""
        with self._lock:
            if not self._past:
                return
            self._wish, self._last = self._past.pop(), 0.0
            self._stand(self._wish)
            self._enable()
            self._changed(self._wish)

    def _moved(self, _: object) -> None:
        with self._lock:
            if self._setting:
                return
            wish = self._read()
            if wish == self._wish:
                return
            now = time.monotonic()
            if now - self._last > PAUSE:
                self._past = [*self._past[1 - MOST_UNDO :], self._wish]
            self._wish, self._last = wish, now
            self._enable()
            self._changed(wish)

    def _read(self) -> Wish:
        kyphosis = None if self._kyphosis is None else self._kyphosis.value
        return Wish(
            uiv=self._uiv.value,
            liv=self._liv.value,
            correction={apex: sliders.correction.value for apex, sliders in self._curves.items()},
            derotation={apex: sliders.derotation.value for apex, sliders in self._curves.items()},
            kyphosis=None if kyphosis is None or kyphosis == self._still else kyphosis,
        )

    def _stand(self, wish: Wish) -> None:
        """Puts the sliders where a wish has them."""
        self._setting = True
        try:
            self._uiv.value, self._liv.value = wish.uiv, wish.liv
            for apex, sliders in self._curves.items():
                sliders.correction.value = wish.correction[apex]
                sliders.derotation.value = wish.derotation[apex]
            if self._kyphosis is not None:
                self._kyphosis.value = self._still if wish.kyphosis is None else wish.kyphosis
        finally:
            self._setting = False

    def _enable(self) -> None:
        """A curve outside the fusion follows by itself: its sliders say nothing."""
        self._undo.disabled = not self._past
        levels = set(self._spine.levels)
        if not {self._wish.uiv, self._wish.liv} <= levels:
            return
        for apex, sliders in self._curves.items():
            for slider in (sliders.correction, sliders.derotation):
                slider.disabled = not self._wish.fuses(apex)

    def _handles(self) -> list[Any]:
        curves = [handle for s in self._curves.values() for handle in (s.correction, s.derotation)]
        return [self._uiv, self._liv, *curves, *([] if self._kyphosis is None else [self._kyphosis])]
