"""The planning page: what is asked in browsers goes to the session, what the session knows to the browsers."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from warp_trunk.case.landmarks import NO_LANDMARKS
from warp_trunk.errors import InputError
from warp_trunk.measures import measure

from .controls import MotionControls, WishControls
from .kept import KeptPlans
from .latest import Latest, worker
from .loopback import LoopbackServer
from .motion_wish import first_motions
from .numbers import line_html, numbers_html, status_html
from .scene import SIDES, Scene
from .session import LateMeasures, PlanView, Refusal, Session
from .wish import first_wish, spine_before

if TYPE_CHECKING:
    import viser

    from warp_trunk.bone_motion.plan import Plan
    from warp_trunk.run.patient import Patient

NOTHING = "nothing"
"""The first choice of the comparison."""
PAUSE = 0.1
"""From one table of numbers to the next [s]: a reader needs no more, and a browser lays out each of them again."""


class Page:
    """The page of one patient, open as long as the block that it is entered for."""

    def __init__(self, patient: Patient, folder: Path, port: int, plan: Plan | None = None) -> None:
        """Opens the port; nothing is planned yet.

        Args:
            patient: made ready; her model belongs to the page from now on.
            folder: where kept plans go.
            port: where the page is, on this machine alone.
            plan: where the sliders stand first; at rest when left out.

        Raises:
            InputError: the port is taken.
        """
        self._case = case = patient.case
        self.stopped = threading.Event()
        """Set when the page is to end."""
        self.failure: str | None = None
        """The error that ended the page, if there was one."""
        self.kept = KeptPlans(folder, case)
        """The plans that were kept, now and before."""
        self._before = measure(case.skin, case.landmarks_before if case.has_spine else NO_LANDMARKS)
        self._view: PlanView | None = None
        self._refusal: Refusal | None = None
        self._measures = self._before
        self._drawing = threading.Lock()
        self._told: Latest[Callable[[], str]] = Latest(PAUSE)
        self._writer = worker("writing", self._write_numbers, self._fail)
        self.server = LoopbackServer(port, case.name)
        """The server; it is on `server.address`."""
        self._session = Session(patient, plan, self._show, self._fail)
        self.scene = Scene(self.server, case)
        """The objects that are drawn."""
        gui = self.server.gui
        gui.main_panel.dock_left()
        self._status = gui.add_html(status_html(None, None))
        if case.has_spine:
            spine = spine_before(case.landmarks_before)
            wish = first_wish(spine, plan)
            self.controls = WishControls(gui, spine, wish, self._session.ask)
        else:
            wish = first_motions(case)
            self.controls = MotionControls(gui, wish, self._session.ask)
        self._add_keeping(gui)
        self._add_looks(gui)
        panel = gui.add_panel()
        with panel.add_tab("Numbers"):
            self._numbers = gui.add_html("")
        panel.dock_right()
        self._first = wish

    def __enter__(self) -> Page:
        self._writer.start()
        self._session.__enter__()
        self._session.ask(self._first)
        return self

    def __exit__(self, *_: object) -> None:
        self._session.__exit__()
        self._told.close()
        self._writer.join()
        self.server.stop()

    @property
    def view(self) -> PlanView | None:
        """The view that is shown."""
        return self._view

    def _add_keeping(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Keep and compare"):
            self._name = gui.add_text("Name", self.kept.free_name())
            gui.add_button("Keep this plan").on_click(lambda _: self._keep())
            self._said = gui.add_html("")
            self._other = gui.add_dropdown("Compare with", self._to_compare())
            self._other.on_update(lambda _: self._compare())

    def _add_looks(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Look"):
            side = gui.add_button_group("From", tuple(SIDES))
            for label, shows, first in (
                ("Before surgery", self.scene.show_before, False),
                ("Skin transparent", self.scene.show_through, True),
                ("Lines of depth", self.scene.show_relief, self._case.has_spine),
            ):
                box = gui.add_checkbox(label, first)
                box.on_update(lambda event, shows=shows: self._draw(shows, event.target.value))
        gui.add_button("End", color="gray", hint="Ends the page for everyone; what was kept stays").on_click(
            lambda _: self.stopped.set()
        )

        @side.on_click
        def _(event: viser.GuiEvent) -> None:
            if event.client is not None and event.target.value in SIDES:
                self.scene.look(event.client.camera, event.target.value)

    def _draw(self, shows: Callable[[bool], None], value: bool) -> None:
        with self._drawing:
            shows(bool(value))

    def _show(self, told: PlanView | Refusal | LateMeasures) -> None:
        """Draws a view of the session; the session reports one view after another."""
        with self._drawing, self.server.atomic():
            if isinstance(told, LateMeasures):
                self._measures = told.measures
            elif isinstance(told, Refusal):
                self._refusal = told
            else:
                if self._view is None or told.number > self._view.number:
                    self._refusal = None
                redrawn = self._view is None or told.skin is not self._view.skin
                self._view = told
                if redrawn:  # measures come later than the skin that they are of
                    self.scene.show(told)
                if told.measures is not None:
                    self._measures = told.measures
                    self.kept.improve(told)
            self._write()
        self.server.flush()  # else it waits for the next sixtieth of a second

    def _write(self) -> None:
        self._status.content = status_html(self._view, self._refusal)
        if self._view is not None:
            kept = self.kept.get(self._other.value)
            named = None if kept is None else (self._other.value, kept)
            self._told.put(partial(numbers_html, self._case, self._before, self._view, self._measures, named))

    def _write_numbers(self) -> None:
        while (numbers := self._told.take()) is not None:
            self._numbers.content = numbers()

    def _keep(self) -> None:
        view = self._view
        if view is None:
            return
        name = self._name.value.strip()
        try:
            folder = self.kept.keep(name, view)
        except InputError as error:
            self._said.content = line_html(str(error))
            return
        self._said.content = line_html(f"Kept: {folder}")
        self._name.value = self.kept.free_name()
        self._other.options = self._to_compare()

    def _to_compare(self) -> tuple[str, ...]:
        return NOTHING, *self.kept.names

    def _compare(self) -> None:
        name = self._other.value
        plan = self.kept.plan(name)
        if plan is not None and self.kept.get(name) is None:
            wish = first_wish(spine_before(self._case.landmarks_before), plan)
            try:
                self._session.look_at(plan, wish, lambda view: self._found(name, view))
            except InputError as error:
                self._said.content = line_html(f"{name}: {error}")
        self._draw_other()

    def _found(self, name: str, view: PlanView) -> None:
        """Takes a view of a plan that was kept before the page was opened."""
        self.kept.found(name, view)
        if self._other.value == name:
            self._draw_other()

    def _draw_other(self) -> None:
        kept = self.kept.get(self._other.value)
        with self._drawing:
            self.scene.compare(None if kept is None else kept.skin)
            self._write()

    def _fail(self, failure: str) -> None:
        self.failure = failure
        self.stopped.set()
