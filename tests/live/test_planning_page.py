"""The planning page without a browser: its scene, switches and numbers as texts, and what its buttons do."""

import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import viser

from support.asserting import not_none
from support.drawn import Page as Table
from support.known_patient import PLAN, exchange_sides, known_case, known_part
from support.shown import check_shown, described, scene_lines
from support.small_trunk import APEX, small_patient
from support.synthetic import box
from warp_trunk.bone_motion.plan import CurvePlan, Plan, PlannedSurgery, plan_surgery
from warp_trunk.case import Case
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.live.number_table import numbers_html
from warp_trunk.live.page_scene import SIDES
from warp_trunk.live.planning_page import NOTHING, Page
from warp_trunk.live.session import PlanView
from warp_trunk.live.sliders import MotionSliders, Sliders, SpineSliders, first_state, with_handles
from warp_trunk.measures import measure
from warp_trunk.measures.quantities import PREDICTED, Measured
from warp_trunk.recording.viewer import free_port
from warp_trunk.run.patient import motions_of

WAIT = 60.0


def until(true: Callable[[], bool]) -> None:
    end = time.monotonic() + WAIT
    while not true() and time.monotonic() < end:
        time.sleep(0.02)
    assert true()


def control(page: Page, label: str) -> Any:
    """The handle with a label; a group of buttons has it on one of them."""
    handles = page.server.gui._gui_input_handle_from_uuid.values()
    return next(handle for handle in handles if getattr(handle, "label", None) == label)


def press(handle: Any, client: Any = None) -> None:
    for heard in handle._impl.update_cb:
        heard(viser.GuiEvent(client=client, client_id=None, target=handle))


class Watched:
    """A page that nothing runs behind, and what each event changes on it."""

    def __init__(self, case: Case, sliders: Sliders, folder: Path) -> None:
        self.page = Page(replace(small_patient(), case=case), sliders, folder, free_port())
        self.shown, self._last = list[str](), list[str]()
        self.after("at first", lambda: None)

    def after(self, what: str, event: Callable[[], object]) -> None:
        """Notes the objects and controls that an event changes."""
        event()
        if self.page._told.waits:
            self.page._numbers.content = not_none(self.page._told.take())()
        now = list(scene_lines(self.page.server))
        self.shown += [f"==== {what}", *(line for line in now if line not in self._last)]
        self._last = now

    def show(self, what: str, view: PlanView) -> None:
        def event() -> None:
            self.page.session.view = view
            self.page._show()

        self.after(what, event)

    def switch(self, label: str, value: Any) -> None:
        self.after(f"{label}: {value}", lambda: setattr(control(self.page, label), "value", value))

    def look(self, side: str, aspect: float) -> None:
        """The eye of a browser after a press of the buttons, in a window as wide as a part of its height."""
        camera = SimpleNamespace(client=SimpleNamespace(atomic=nullcontext), aspect=aspect)
        group: Any = next(
            handle
            for handle in self.page.server.gui._gui_input_handle_from_uuid.values()
            if isinstance(handle, viser.GuiButtonGroupHandle)
        )
        for heard in group._impl.update_cb:
            heard(SimpleNamespace(client=SimpleNamespace(camera=camera), target=SimpleNamespace(value=side)))
            heard(SimpleNamespace(client=None, target=SimpleNamespace(value=side)))  # of no browser
        eye = {name: value for name, value in vars(camera).items() if name not in ("client", "aspect")}
        self.shown.append(f"==== {side}, {aspect:g} as wide as high: {described(eye)}")


def test_the_page_is_as_accepted(tmp_path: Path) -> None:
    """From the first sight through an image, a relaxed plan and another one to a plan that cannot be met."""
    own, mesh, displacement = known_case()
    middles = {
        level: own.landmarks_before.of_bone(level).points.mean(axis=0) for level in ("T3", "T4", "T12", "L1")
    }
    small = box((20.0, 16.0, 12.0))
    colours = np.where(own.skin.vertices[:, :1] > 0.0, [200, 90, 80], [90, 90, 200]).astype(np.uint8)
    case = replace(
        own,
        skin=replace(own.skin, colours=colours),
        bones={level: small.moved(small.vertices + at) for level, at in middles.items()},
        unseen=(own.skin.vertices[:, 1] < 0.0).astype(np.float64),
    )
    image = case.skin.moved((mesh.nodes + 0.5 * displacement)[mesh.skin_nodes])
    skin = case.skin.moved((mesh.nodes + displacement)[mesh.skin_nodes])
    surgery = replace(plan_surgery(case, PLAN), landmarks_after=case.planned_landmarks)
    turned = RigidMotion.exp(np.array([0.0, 0.0, 0.1, 1.0, 2.0, 3.0]))
    first = PlanView(1, {}, surgery, dict.fromkeys(case.bones, turned), image.vertices)
    relaxed = replace(
        first, skin=skin.vertices, error=0.05, warnings=("Look <here>.",), relaxed=True,
        measures=measure(skin, case.planned_landmarks, case.skin, case.unseen),
    )  # fmt: skip
    settled = replace(
        relaxed, settled=True, intervals=(Measured(PREDICTED, "T8", "bsr_deg", 7.3, 4.0, 10.0),
                                          Measured.with_sd(PREDICTED, "L3", "bsr_deg", -15.2, 20.0)),
    )  # fmt: skip
    watched = Watched(case, SpineSliders(case, PLAN), tmp_path)
    page = watched.page
    try:
        watched.switch("Own colours", True)
        for side, aspect in ((side, aspect) for side in SIDES for aspect in (0.4, 2.0)):
            watched.look(side, aspect)
        watched.show("the image of a plan", first)
        watched.show("its skin is relaxed", relaxed)
        watched.show("... to the end, with intervals", settled)
        for label in ("Own colours", "Skin transparent", "Lines of depth", "Names of vertebrae", "Clothes"):
            watched.switch(label, False)
        watched.switch("Before surgery", True)
        watched.switch("Own colours", True)
        for label in ("Before surgery", "Own colours"):
            watched.switch(label, False)
        for label in ("Skin transparent", "Lines of depth", "Names of vertebrae", "Clothes"):
            watched.switch(label, True)
        page.saved.views["<mine>"] = replace(first, measures=page.session.before)
        control(page, "Compare with").options = (NOTHING, "<mine>")
        watched.switch("Compare with", "<mine>")
        page.session.refusal = "the upper vertebra must lie above"
        watched.after("a wish that is refused", page._show)
        page.session.refusal, page.session.doing, page.session.intervals = "", "step 3", "Computing."
        watched.show("another image while a relaxation runs", replace(first, number=2, error=2.34))
        page.session.planning = True
        watched.after("a newer wish", page._show)
        watched.switch("Compare with", NOTHING)
    finally:
        page.server.stop()
    check_shown("planning_page", watched.shown)


def test_the_page_of_a_part_is_as_accepted(tmp_path: Path) -> None:
    """Points follow the motions of bones; there is no spine to name, to dress or to measure."""
    part, mesh, displacement = known_part()
    case = with_handles(part)
    sliders = MotionSliders(case)
    surgery = sliders.surgery(first_state(sliders))
    skin = (mesh.nodes + displacement)[mesh.skin_nodes]
    view = PlanView(1, {}, surgery, motions_of(surgery.planned_case(case)), skin, 12.3)
    watched = Watched(case, sliders, tmp_path)
    try:
        watched.show("the image of a plan", view)
    finally:
        watched.page.server.stop()
    check_shown("planning_page_of_part", watched.shown)


def test_the_numbers_of_the_mirror_image_are_on_the_other_side() -> None:
    tables = []
    for mirrored in (False, True):
        case, mesh, displacement = known_case(mirrored=mirrored)
        skin = case.skin.moved(case.skin.vertices + displacement[mesh.skin_nodes])
        surgery = replace(plan_surgery(case, PLAN), landmarks_after=case.planned_landmarks)
        after = measure(skin, case.planned_landmarks, case.skin)
        view = PlanView(1, {}, surgery, {}, skin.vertices, relaxed=True, measures=after)
        tables.append(Table(numbers_html(case, measure(case.skin, case.landmarks_before), view)).rows)
    own = {exchange_sides(title): [exchange_sides(cell) for cell in cells] for title, cells in tables[0].items()}
    assert tables[1] == own


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """The page of a patient with a plan of half the curve, while her plans are relaxed."""
    patient = small_patient()
    plan = Plan(uiv="T4", liv="T11", curves=(CurvePlan(apex=APEX, correction=0.5),))
    folder = tmp_path_factory.mktemp("page") / "plans"
    with Page(patient, SpineSliders(patient.case, plan), folder, free_port()) as page:
        until(lambda: page.session.view is not None and page.session.view.measures is not None)
        yield page
        assert page.failure is None


def test_a_kept_plan_is_a_folder_a_name_and_outlines(page: Page) -> None:
    assert control(page, "Name").value == "plan_1"
    press(control(page, "Keep this plan"))
    assert f"Kept: {page.saved.folder / 'plan_1'}" in page._said.content
    assert (page.saved.folder / "plan_1" / "plan.toml").is_file()
    assert control(page, "Name").value == "plan_2"
    other = control(page, "Compare with")
    assert other.options == (NOTHING, "plan_1")
    other.value = "plan_1"
    until(lambda: "■</span> plan_1" in page._numbers.content)
    z = np.asarray(page.scene.compared.points)[..., 2]
    skin = not_none(page.session.view).skin
    assert skin[:, 2].min() - 1e-3 <= z.min() < z.max() <= skin[:, 2].max() + 1e-3
    other.value = NOTHING
    until(lambda: "■</span> plan_1" not in page._numbers.content)
    control(page, "Name").value = "a/b"
    press(control(page, "Keep this plan"))
    assert "cannot name a plan" in page._said.content
    assert page.saved.names == ("plan_1",)


def test_only_the_browser_that_ends_the_page_is_asked_and_its_answer_counts(page: Page) -> None:
    press(control(page, "End"))
    client = SimpleNamespace(gui=page.server.gui)
    for answer, ends in (("Continue planning", False), ("End the page", True)):
        press(control(page, "End"), client)
        press(control(page, answer))
        assert page.stopped.is_set() == ends
    page.stopped.clear()


def test_a_slider_moves_skin_numbers_and_status(page: Page) -> None:
    view = not_none(page.session.view)
    slider = control(page, "Correction %")
    slider.value = 20
    until(lambda: not_none(page.session.view).number > view.number and not_none(page.session.view).settled)
    until(lambda: not_none(page.session.view).measures is not None)
    newer = not_none(page.session.view)
    assert isinstance(newer.surgery, PlannedSurgery)
    assert isinstance(view.surgery, PlannedSurgery)
    assert newer.surgery.curves[1].cobb_after > view.surgery.curves[1].cobb_after + 4.0
    angle = f"{newer.surgery.curves[1].cobb_after:.0f}"
    until(lambda: angle in [row[1] for title, row in Table(page._numbers.content).rows.items() if "Cobb" in title])
    np.testing.assert_allclose(page.scene.skin.vertices, newer.skin.astype(np.float32))
    assert "Relaxed skin" in page._status.content
    press(control(page, "Undo"))
    assert slider.value == 50
