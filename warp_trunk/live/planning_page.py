"""The planning page: what is asked in browsers goes to the session, what the session knows to the browsers."""

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Self

import viser

from warp_trunk.bone_motion.plan.plan_file import patient_name
from warp_trunk.errors import InputError
from warp_trunk.run.patient import PreparedPatient

from .loopback import BUTTONS, LoopbackServer
from .number_table import line_html, numbers_html, status_html
from .page_scene import SIDES, PageScene
from .saved_plans import SavedPlans
from .session import Latest, PlanView, Session, worker
from .sliders import Controls, Sliders, SpineSliders, first_state

NOTHING = "nothing"
"""The first choice of the comparison."""
PAUSE = 0.1
"""From one table of numbers to the next [s]: a reader needs no more, and a browser lays out each of them again."""


class Page:
    """The page of one patient, open as long as the block that it is entered for."""

    def __init__(self, patient: PreparedPatient, sliders: Sliders, folder: Path, port: int) -> None:
        """Opens the port; nothing is planned yet.

        Args:
            patient: made ready; her model belongs to the page from now on.
            sliders: what can be planned.
            folder: where kept plans go.
            port: where the page is, on this machine alone.

        Raises:
            InputError: the port is taken.
        """
        self._case = case = patient.case
        self.stopped = threading.Event()
        """Set when the page is to end."""
        self.failure: str | None = None
        """The error that ended the page, if there was one."""
        self.saved = SavedPlans(folder, case)
        """The plans that were kept, now and before."""
        self._drawn: PlanView | None = None
        self._drawing = threading.Lock()
        self._told: Latest[Callable[[], str]] = Latest(PAUSE)
        self._writer = worker("writing", self._write_numbers, self._fail)
        self.server = LoopbackServer(port, patient_name(case))
        """The server; it is on `server.address`."""
        self.session = Session(patient, sliders, self._show, self._fail)
        """The plan and the picture of the page."""
        self._sliders = sliders
        self.scene = PageScene(self.server, case)
        """The objects that are drawn."""
        gui = self.server.gui
        self.server.on_client_connect(lambda client: self.scene.stand_back(client.camera))
        gui.main_panel.dock_left()
        self._status = gui.add_html(status_html(None, ""))
        self.controls = Controls(gui, sliders, self.session.ask)
        with gui.add_folder("Keep and compare"):
            self._name = gui.add_text("Name", self.saved.free_name())
            gui.add_button("Keep this plan", color=BUTTONS).on_click(lambda _: self._keep())
            self._said = gui.add_html("")
            self._other = gui.add_dropdown("Compare with", (NOTHING, *self.saved.names))
            self._other.on_update(lambda _: self._compare())
        self._add_looks(gui)
        panel = gui.add_panel()
        with panel.add_tab("Numbers"):
            hint = "95 % intervals from the errors that case.toml states; some seconds to a minute"
            self._find = gui.add_button("Compute intervals", hint=hint, color=BUTTONS)
            self._find.on_click(lambda _: self.session.ask_for_intervals())
            self._intervals = gui.add_html("")
            self._numbers = gui.add_html("")
        panel.dock_right()

    def __enter__(self) -> Self:
        self._writer.start()
        self.session.__enter__()
        self.session.ask(first_state(self._sliders))
        return self

    def __exit__(self, *_: object) -> None:
        self.session.__exit__()
        self._told.close()
        self._writer.join()
        self.server.stop()

    def _add_looks(self, gui: viser.GuiApi) -> None:
        def look(event: viser.GuiEvent) -> None:
            if event.client is not None and event.target.value in SIDES:
                self.scene.look(event.client.camera, event.target.value)

        def draw(event: viser.GuiEvent, shows: Callable[[bool], None]) -> None:
            with self._drawing:
                shows(bool(event.target.value))

        with gui.add_folder("Look"):
            gui.add_button_group("From", tuple(SIDES)).on_click(look)
            looks = [
                ("Before surgery", self.scene.show_before, False),
                ("Skin transparent", self.scene.show_through, True),
                ("Lines of depth", self.scene.show_relief, self._case.has_spine),
                ("Names of vertebrae", self.scene.show_names, self._case.has_spine),
            ]
            if self.scene.garment is not None:
                looks.append(("Clothes", self.scene.show_clothes, True))
            if self._case.skin.colours is not None:
                looks.append(("Own colours", self.scene.show_own, False))
            for label, shows, first in looks:
                gui.add_checkbox(label, first).on_update(partial(draw, shows=shows))
        end = gui.add_button("End", color="dark", hint="Ends the page for everyone; what was kept stays")
        end.on_click(self._ask_to_end)

    def _ask_to_end(self, event: viser.GuiEvent) -> None:
        """Asks the browser in which `End` was clicked, as the page ends for all."""
        if event.client is None:
            return
        gui = event.client.gui
        with gui.add_modal("End the page for everyone?") as question:
            gui.add_markdown("What was kept stays. The plan on the sliders is lost.")
            gui.add_button("End the page", color="red").on_click(lambda _: self.stopped.set())
            gui.add_button("Continue planning", color=BUTTONS).on_click(lambda _: question.close())

    def _show(self) -> None:
        """Draws what the session knows; called for one change after another."""
        view = self.session.view
        with self._drawing, self.server.atomic():
            if view is not None:
                if self._drawn is None or view.skin is not self._drawn.skin:  # measures come later than their skin
                    self.scene.show(view)
                self._drawn = view
                if view.measures is not None:
                    self.saved.improve(view)
            self._write()
        self.server.flush()  # else it waits for the next sixtieth of a second

    def _write(self) -> None:
        session, name = self.session, self._other.value
        view, invented = session.view, self._case.unseen is not None
        self._status.content = status_html(
            view, session.refusal, planning=session.planning, doing=session.doing, invented=invented
        )
        self._intervals.content = line_html(session.intervals) if session.intervals else ""
        self._find.disabled = view is None or bool(session.intervals or view.intervals)
        if view is not None:
            other = self.saved.views.get(name)
            named = None if other is None else (name, other)
            self._told.put(partial(numbers_html, self._case, session.before, view, named))

    def _write_numbers(self) -> None:
        while (numbers := self._told.take()) is not None:
            self._numbers.content = numbers()

    def _keep(self) -> None:
        view = self.session.view
        if view is None:
            return
        try:
            folder = self.saved.keep(self._name.value.strip(), view)
        except InputError as error:
            self._said.content = line_html(str(error))
            return
        self._said.content = line_html(f"Kept: {folder}")
        self._name.value = self.saved.free_name()
        self._other.options = (NOTHING, *self.saved.names)

    def _compare(self) -> None:
        """Draws the chosen plan; one that was kept before the page was opened is relaxed first."""
        name = self._other.value
        plan = self.saved.earlier.get(name)
        if plan is not None and name not in self.saved.views and isinstance(self._sliders, SpineSliders):
            try:
                self.session.relax_beside(self._sliders.of_plan(plan), partial(self._add_view, name))
            except InputError as error:
                self._said.content = line_html(f"{name}: {error}")
        self._draw_other()

    def _add_view(self, name: str, view: PlanView) -> None:
        self.saved.views[name] = view
        self._draw_other()

    def _draw_other(self) -> None:
        other = self.saved.views.get(self._other.value)
        with self._drawing:
            self.scene.compare(None if other is None else other.skin)
            self._write()

    def _fail(self, failure: str) -> None:
        self.failure = failure
        self.stopped.set()
