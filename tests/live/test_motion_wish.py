"""Sliders of motions: from motions.toml to sliders and back, and the end is that of a simulation."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from support.chromium import CHROMIUM, QUIET, needs_chromium
from support.part_phantom import part_case
from warp_trunk.case import Case, read_case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.motions import Motion, Turn, rigid_motions
from warp_trunk.case.points import Points
from warp_trunk.engine.simulation import simulate
from warp_trunk.errors import InputError
from warp_trunk.live.motion_wish import Components, MotionPlanner, MotionWish, first_motions, with_handles
from warp_trunk.live.page import Page
from warp_trunk.live.session import PlanView, Refusal, Session
from warp_trunk.meshing import MeshOptions
from warp_trunk.recording.viewer import free_port
from warp_trunk.run.options import RunOptions
from warp_trunk.run.patient import Patient, patient_of, prepare_plan

OPTIONS = RunOptions(mesh=MeshOptions(tets=8000, bone_voxel=4.0, cache=False), device="cpu", threads=1)
TURN = Turn(degrees=5.0, axis=(0.0, 0.0, 2.0), point=(0.0, -45.0, 100.0))
MOTIONS = {"front": Motion(translation=(0.0, -4.0, 0.0), rotation=TURN), "left": Motion(follows={"front": 0.5})}


def case_of(**motions: Motion) -> Case:
    marks = Landmarks(("tip", "bone"), np.array([[0.0, -80.0, 100.0], [0.0, -63.0, 100.0]]))
    return replace(part_case(**motions), points=Points(marks, {"tip": "bone"}))


@pytest.fixture(scope="module")
def patient() -> Patient:
    return patient_of(with_handles(case_of(**MOTIONS)), OPTIONS)


@pytest.fixture
def wish(patient: Patient) -> MotionWish:
    return first_motions(patient.case)


def test_sliders_stand_where_the_motions_of_the_case_are() -> None:
    shift = RigidTransform.from_exp_coords([0.1, -0.2, 0.3, 4.0, 5.0, 6.0])
    rows: tuple = tuple(map(tuple, shift.as_matrix().tolist()))
    case = case_of(**MOTIONS, right=Motion(transform=rows, large=True))
    wish = first_motions(case)
    assert wish.components["front"].rotation == pytest.approx((0.0, 0.0, 5.0))
    assert wish.components["left"].follows == (("front", 0.5),)
    assert wish.plan()["right"].large
    given, found = rigid_motions(case.motions), rigid_motions(wish.plan())
    for bone, motion in given.items():
        np.testing.assert_allclose(found[bone].as_matrix(), motion.as_matrix(), atol=1e-6)


def test_sliders_at_zero_move_nothing() -> None:
    still = MotionWish({"front": Components(), "left": Components(follows=(("front", 0.0),))})
    plan = MotionPlanner(with_handles(case_of(**MOTIONS))).plan(still.plan())
    assert not any(motion.as_exp_coords().any() for motion in plan.bones.values())


def test_a_bone_must_not_pass_into_another(patient: Patient) -> None:
    far = MotionWish({"front": Components(translation=(0.0, 35.0, 0.0))})
    with pytest.raises(InputError, match=r"'front' passes .* into 'core'"):
        MotionPlanner(patient.case).plan(far.plan())


def test_the_end_is_that_of_a_simulation(patient: Patient, wish: MotionWish) -> None:
    more, told, faults = threading.Condition(), [], []

    def show(what: object) -> None:
        with more:
            told.append(what)
            more.notify_all()

    forward = replace(wish.components["front"], translation=(0.0, -7.0, 1.0))
    last = replace(wish, components={**wish.components, "front": forward})
    into = replace(wish, components={"front": Components(translation=(0.0, 35.0, 0.0))})
    with Session(patient, None, show, faults.append) as session, more:
        for asked in (wish, into, last):
            session.ask(asked)
            more.wait_for(
                lambda asked=asked: any(
                    one.wish == asked and (isinstance(one, Refusal) or (one.settled and one.measures))
                    for one in told
                    if isinstance(one, Refusal | PlanView)
                ),
                60.0,
            )
    assert faults == []
    assert any(isinstance(one, Refusal) and one.reason.startswith("'front' passes") for one in told)
    view = next(one for one in reversed(told) if isinstance(one, PlanView))
    assert (view.wish, view.settled) == (last, True)
    alone = patient_of(case_of(**MOTIONS), OPTIONS)
    planned = view.surgery.planned_case(alone.case)
    *_, end = simulate(alone.model, prepare_plan(alone, planned).bone_path, alone.options.simulation)
    off = view.skin - planned.skin.vertices - end.displacement[alone.trunk.skin_nodes]
    assert np.linalg.norm(off, axis=1).max() <= 2.0 * alone.options.simulation.relax.tolerance


@needs_chromium
def test_the_page_has_a_slider_for_each_component_and_keeps_a_case(patient: Patient, tmp_path: Path) -> None:
    from playwright.sync_api import expect, sync_playwright

    with Page(patient, tmp_path / "plans", free_port()) as page, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(QUIET))
        tab = browser.new_page()
        tab.goto(page.server.address)
        body = tab.locator("body")
        for words in ("of its equilibrium", "Left mm", "Yaw °", "Follows front %", "tip, ratio to bone"):
            expect(body).to_contain_text(words, timeout=60_000.0)
        expect(body).not_to_contain_text("Cobb")
        assert tab.get_by_role("slider").count() == 7
        tab.get_by_role("button", name="Keep this plan", exact=True).dispatch_event("click")
        expect(body).to_contain_text("Kept: ", timeout=60_000.0)
        browser.close()
        assert page.failure is None
    kept = read_case(tmp_path / "plans" / "plan_1")
    assert kept.landmarks_before.names == ()
    assert kept.points.pairs == {"tip": "bone"}
    for bone, motion in rigid_motions(kept.motions).items():
        np.testing.assert_allclose(motion.as_matrix(), rigid_motions(MOTIONS)[bone].as_matrix(), atol=1e-6)
