"""The sliders and buttons of the page, and where they stood before."""

from __future__ import annotations

import math
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from .motion_wish import MotionWish
from .wish import Spine, Wish

if TYPE_CHECKING:
    import viser

PAUSE = 0.7
"""Sliders that rest for so long [s] have been let go: undo goes back to where they were then."""
MOST_UNDO = 100
"""Number of wishes that can be undone."""
KYPHOSIS = (0, 90)
"""Range of the targets of a plan [degrees]."""
REACH = 20
"""A slider of a motion reaches at least this far to either side [mm or degrees]."""
COMPONENTS = ("Left mm", "Back mm", "Up mm", "Pitch °", "Roll °", "Yaw °")
"""Labels of the components of a motion: translation along and rotation vector about x, y and z in LPS."""
AnyWish = TypeVar("AnyWish", Wish, MotionWish)


@dataclass(frozen=True)
class _Sliders:
    """One curve's."""

    correction: viser.GuiSliderHandle[int]
    derotation: viser.GuiSliderHandle[int]


class Controls(ABC, Generic[AnyWish]):
    """Sliders, with undo. All browsers share them."""

    def __init__(self, wish: AnyWish, changed: Callable[[AnyWish], None]) -> None:
        """No slider yet; a subclass adds them and calls `_watch`.

        Args:
            wish: the first slider positions.
            changed: called with each wish, from any thread.
        """
        self._changed = changed
        self._lock = threading.RLock()
        self._setting = False
        self._wish, self._past, self._last = wish, list[AnyWish](), 0.0

    def _watch(self, gui: viser.GuiApi) -> None:
        """Listen to the sliders and add the undo button."""
        for handle in self._handles():
            handle.on_update(self._moved)
        self._undo = gui.add_button("Undo", disabled=True)
        self._undo.on_click(lambda _: self.undo())
        self._enable()

    def undo(self) -> None:
        """Return to the previous resting position of the sliders."""
        with self._lock:
            if not self._past:
                return
            self._wish, self._last = self._past.pop(), 0.0
            self._setting = True
            try:
                self._stand(self._wish)
            finally:
                self._setting = False
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

    def _enable(self) -> None:
        """Disable the controls that have no effect."""
        self._undo.disabled = not self._past

    @abstractmethod
    def _read(self) -> AnyWish:
        """The wish of the slider positions."""

    @abstractmethod
    def _stand(self, wish: AnyWish) -> None:
        """Move the sliders to a wish."""

    @abstractmethod
    def _handles(self) -> list[Any]:
        """All controls that make up a wish."""


class MotionControls(Controls[MotionWish]):
    """A slider for each component of the motion of each bone."""

    def __init__(self, gui: viser.GuiApi, wish: MotionWish, changed: Callable[[MotionWish], None]) -> None:
        """Add the sliders to the page; the arguments are those of `Controls`."""
        super().__init__(wish, changed)
        self._sliders: dict[str, list[Any]] = {}
        for bone, own in wish.components.items():
            with gui.add_folder(bone):
                if own.follows:
                    self._sliders[bone] = [
                        gui.add_slider(f"Follows {other} %", 0, 100, 1, round(100.0 * share))
                        for other, share in own.follows
                    ]
                    continue
                self._sliders[bone] = [
                    _component(gui, label, value)
                    for label, value in zip(COMPONENTS, (*own.translation, *own.rotation), strict=True)
                ]
        self._watch(gui)

    def _read(self) -> MotionWish:
        components = {}
        for bone, own in self._wish.components.items():
            values = [slider.value for slider in self._sliders[bone]]
            if own.follows:
                shares = zip((other for other, _ in own.follows), values, strict=True)
                components[bone] = replace(own, follows=tuple((other, value / 100.0) for other, value in shares))
            else:
                components[bone] = replace(own, translation=tuple(values[:3]), rotation=tuple(values[3:]))
        return replace(self._wish, components=components)

    def _stand(self, wish: MotionWish) -> None:
        for bone, own in wish.components.items():
            shares = [round(100.0 * share) for _, share in own.follows]
            values = shares or (*own.translation, *own.rotation)
            for slider, value in zip(self._sliders[bone], values, strict=True):
                slider.value = value

    def _handles(self) -> list[Any]:
        return [slider for sliders in self._sliders.values() for slider in sliders]


def _component(gui: viser.GuiApi, label: str, value: float) -> viser.GuiSliderHandle[float]:
    """A slider of a translation [mm] or rotation [degrees] that reaches beyond the first value."""
    most = max(REACH, math.ceil(2.0 * abs(value)))
    return gui.add_slider(label, -most, most, 0.1, value)


class WishControls(Controls[Wish]):
    """Sliders for every curve, kyphosis and the ends of the fusion."""

    def __init__(self, gui: viser.GuiApi, spine: Spine, wish: Wish, changed: Callable[[Wish], None]) -> None:
        """Add the sliders to the page.

        Args:
            gui: the page.
            spine: the spine before surgery.
            wish: the first slider positions.
            changed: called with each wish, from any thread.
        """
        super().__init__(wish, changed)
        self._spine = spine
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
        self._watch(gui)

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
        self._uiv.value, self._liv.value = wish.uiv, wish.liv
        for apex, sliders in self._curves.items():
            sliders.correction.value = wish.correction[apex]
            sliders.derotation.value = wish.derotation[apex]
        if self._kyphosis is not None:
            self._kyphosis.value = self._still if wish.kyphosis is None else wish.kyphosis

    def _enable(self) -> None:
        """Disable the sliders of curves outside the fusion, which follow by themselves."""
        super()._enable()
        levels = set(self._spine.levels)
        if not {self._wish.uiv, self._wish.liv} <= levels:
            return
        for apex, sliders in self._curves.items():
            for slider in (sliders.correction, sliders.derotation):
                slider.disabled = not self._wish.fuses(apex)

    def _handles(self) -> list[Any]:
        curves = [handle for s in self._curves.values() for handle in (s.correction, s.derotation)]
        return [self._uiv, self._liv, *curves, *([] if self._kyphosis is None else [self._kyphosis])]
