"""The planning page without a browser: what its switches, buttons and lists do, and the numbers that it shows."""

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
from support.known_patient import AFTER, BEFORE, exchange_sides, known_case
from support.known_spine import LEVELS
from support.shown import check_shown, scene_lines
from support.small_trunk import APEX, small_patient
from warp_trunk.bone_motion.plan import CurvePlan, Plan, PlannedSurgery, plan_surgery
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.live.number_table import numbers_html
from warp_trunk.live.page_scene import BONE, FUSED, SIDES
from warp_trunk.live.planning_page import NOTHING, Page
from warp_trunk.live.session import PlanView
from warp_trunk.live.sliders import SpineSliders
from warp_trunk.measures import measure
from warp_trunk.measures.quantities import PREDICTED, Measured
from warp_trunk.recording.viewer import free_port

WAIT = 60.0


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """The page of a patient whose scan has colours, with a plan of half the curve."""
    patient = small_patient()
    colours = np.full((len(patient.case.skin.vertices), 3), 200, dtype=np.uint8)
    patient = replace(patient, case=replace(patient.case, skin=replace(patient.case.skin, colours=colours)))
    plan = Plan(uiv="T4", liv="T11", curves=(CurvePlan(apex=APEX, correction=0.5),))
    folder = tmp_path_factory.mktemp("page") / "plans"
    with Page(patient, SpineSliders(patient.case, plan), folder, free_port()) as page:
        until(lambda: page.session.view is not None and page.session.view.measures is not None)
        yield page
        assert page.failure is None


def until(true: Callable[[], bool]) -> None:
    end = time.monotonic() + WAIT
    while not true() and time.monotonic() < end:
        time.sleep(0.02)
    assert true()


def control(page: Page, label: str) -> Any:
    """The handle with a label; a group of buttons has it on one of them."""
    return next(handle for handle in handles(page) if getattr(handle, "label", None) == label)


def handles(page: Page) -> list[Any]:
    return list(page.server.gui._gui_input_handle_from_uuid.values())


def press(handle: Any, client: Any = None) -> None:
    for heard in handle._impl.update_cb:
        heard(viser.GuiEvent(client=client, client_id=None, target=handle))


def switched(page: Page, label: str, on: bool) -> None:
    control(page, label).value = on


def test_each_switch_shows_and_hides_what_it_names(page: Page) -> None:
    scene = page.scene
    first = {"Before surgery": False, "Skin transparent": True, "Lines of depth": True, "Clothes": True,
             "Own colours": False}  # fmt: skip
    assert {label: control(page, label).value for label in first} == first
    assert (scene.skin.visible, scene.before.visible, scene.relief.visible) == (True, False, True)
    assert scene.skin.opacity is not None
    switched(page, "Before surgery", True)
    assert (scene.skin.visible, scene.before.visible) == (False, True)
    switched(page, "Own colours", True)  # of the skin before surgery, too
    assert (scene.skin.visible, scene.before.visible) == (False, False)
    assert not_none(scene.painted).visible
    assert not_none(scene.painted).scale == 1000.0  # its metres are millimetres of the page
    switched(page, "Before surgery", False)
    switched(page, "Own colours", False)
    assert (scene.skin.visible, scene.before.visible) == (True, False)
    assert not not_none(scene.painted).visible
    for label, seen in (
        ("Lines of depth", lambda: scene.relief.visible),
        ("Clothes", lambda: all(cloth.visible for cloth in scene._clothes.values())),
        ("Skin transparent", lambda: scene.skin.opacity is not None and scene.before.opacity is not None),
    ):
        for on in (False, True):
            switched(page, label, on)
            assert seen() == on, label


def test_before_surgery_the_bones_are_where_they_were(page: Page) -> None:
    bone = page.scene._bones["T8"]
    moved, planned = np.array(bone.position), bone.color
    assert np.abs(moved).max() > 0.1
    switched(page, "Before surgery", True)
    np.testing.assert_allclose(bone.position, 0.0, atol=1e-9)
    assert bone.color == BONE
    switched(page, "Before surgery", False)
    np.testing.assert_allclose(bone.position, moved)
    assert planned == bone.color == FUSED
    assert page.scene._bones["rib_left_08"].color == BONE


@pytest.mark.parametrize(("end", "fused"), [("T8", True), ("T7", False)])
def test_vertebrae_of_the_fusion_have_its_colour_with_both_ends(page: Page, end: str, fused: bool) -> None:
    view = not_none(page.session.view)
    plan = Plan(uiv="T4", liv=end, curves=(CurvePlan(apex=APEX, correction=0.5),))
    if not fused:
        plan = replace(plan, liv="T11", uiv="T4")
    surgery = plan_surgery(page.session._patient.case, plan)
    levels = {level for level in LEVELS if 4 <= int(level[1:]) <= int(plan.liv[1:]) and level[0] == "T"}
    from warp_trunk.live.page_scene import _planned_bones

    assert _planned_bones(replace(view, surgery=surgery)) == levels


@pytest.mark.parametrize("side", SIDES)
def test_a_button_turns_the_eye_of_its_browser_to_that_side(page: Page, side: str) -> None:
    camera = SimpleNamespace(client=SimpleNamespace(atomic=nullcontext), aspect=0.5)
    group = next(handle for handle in handles(page) if isinstance(handle, viser.GuiButtonGroupHandle))
    target = SimpleNamespace(value=side)
    listeners: list[Any] = group._impl.update_cb
    for heard in listeners:
        heard(SimpleNamespace(client=SimpleNamespace(camera=camera), target=target))
        heard(SimpleNamespace(client=None, target=target))  # nobody's eye
    across, back, _ = camera.position - camera.look_at
    wanted = {"Behind": (0, 1), "Front": (0, -1), "Left side": (1, 0), "Right side": (-1, 0)}[side]
    np.testing.assert_allclose(np.array([across, back]) / np.hypot(across, back), wanted, atol=1e-9)
    assert camera.up_direction == (0.0, 0.0, 1.0)
    low, high = (getattr(page.session._patient.case.skin.vertices, handle)(axis=0) for handle in ("min", "max"))
    np.testing.assert_allclose(camera.look_at, (low + high) / 2.0)


def test_a_kept_plan_is_a_folder_a_name_and_outlines(page: Page) -> None:
    page_said = page._said
    assert control(page, "Name").value == "plan_1"
    press(control(page, "Keep this plan"))
    assert "Kept: " in page_said.content
    assert "plan_1" in page_said.content
    assert (page.saved.folder / "plan_1" / "plan.toml").is_file()
    assert control(page, "Name").value == "plan_2"
    other = control(page, "Compare with")
    assert other.options == (NOTHING, "plan_1")
    other.value = "plan_1"
    view = not_none(page.session.view)
    assert page.scene.compared.visible
    z = np.asarray(page.scene.compared.points)[..., 2]
    assert view.skin[:, 2].min() - 1e-3 <= z.min() < z.max() <= view.skin[:, 2].max() + 1e-3
    until(lambda: "■</span> plan_1" in page._numbers.content)
    other.value = NOTHING
    assert not page.scene.compared.visible
    until(lambda: "■</span> plan_1" not in page._numbers.content)
    control(page, "Name").value = "a/b"
    press(control(page, "Keep this plan"))
    assert "Kept: " not in page_said.content
    assert page.saved.names == ("plan_1",)


def test_only_the_browser_that_ends_the_page_is_asked_and_its_answer_counts(page: Page) -> None:
    press(control(page, "End"))
    gui = page.server.gui
    client = SimpleNamespace(gui=gui)
    press(control(page, "End"), client)
    press(control(page, "Continue planning"))
    assert not page.stopped.is_set()
    press(control(page, "End"), client)
    press(control(page, "End the page"))
    assert page.stopped.is_set()
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


@pytest.mark.parametrize("mirrored", [False, True], ids=["patient", "mirror image"])
def test_the_numbers_beside_the_sliders_are_those_of_the_construction(mirrored: bool) -> None:
    """The number and the side of the rows that plans are chosen by."""
    case, mesh, displacement = known_case(mirrored=mirrored)
    skin = case.skin.moved(case.skin.vertices + displacement[mesh.skin_nodes])
    plan = Plan(uiv="T4", liv="L1", curves=(CurvePlan("T8", correction=0.5),))
    surgery = replace(plan_surgery(case, plan), landmarks_after=case.planned_landmarks)
    before = measure(case.skin, case.landmarks_before)
    after = measure(skin, case.planned_landmarks, case.skin)
    view = PlanView(1, {}, surgery, {}, skin.vertices, relaxed=True, measures=after)
    text = numbers_html(case, before, view)
    rows = Table(text).rows
    side = exchange_sides if mirrored else str
    humps, shoulders = ([abs(pick(shape)) for shape in (BEFORE, AFTER)] for pick in (
        lambda shape: shape.humps["T8"], lambda shape: shape.shoulder_difference))  # fmt: skip
    for title, cells in {
        "Main hump, at T8": [f"{hump:.0f} right" for hump in humps],
        "Deeper waist": ["15 left", "7.0 left"],
        "Higher waist": ["20 left", "12 left"],
        "Higher shoulder": [f"{shoulders[0]:.0f} right", f"{shoulders[1]:.1f} right"],
    }.items():
        (shown,) = (row for name, row in rows.items() if name.startswith(title))
        assert shown == [side(cell) for cell in cells], title


def test_the_page_with_a_plan_is_as_accepted(tmp_path: Path) -> None:
    own, mesh, displacement = known_case()
    case = replace(own, unseen=(own.skin.vertices[:, 1] < 0.0).astype(np.float64))
    skin = case.skin.moved((mesh.nodes + displacement)[mesh.skin_nodes])
    plan = Plan(uiv="T4", liv="T12", curves=(CurvePlan(apex="T8", correction=0.5),))
    surgery = replace(plan_surgery(case, plan), landmarks_after=case.planned_landmarks)
    view = PlanView(
        1, {}, surgery, {"T8": RigidMotion.exp(np.array([0.0, 0.0, 0.1, 1.0, 2.0, 3.0]))}, skin.vertices, 0.05,
        ("Look here.",), relaxed=True, settled=True, measures=measure(skin, case.planned_landmarks, case.skin),
        intervals=(Measured(PREDICTED, "T8", "bsr_deg", 7.3, 4.0, 10.0),),
    )  # fmt: skip
    page = Page(replace(small_patient(), case=case), SpineSliders(case, plan), tmp_path, free_port())
    try:
        shown = ["==== before a plan", *scene_lines(page.server)]
        page.session.view = view
        page._show()
        shown += ["==== with a plan", *scene_lines(page.server), numbers_html(case, page.session.before, view)]
    finally:
        page.server.stop()
    check_shown("planning_page", shown)
