"""From sliders to views: the latest state wins, an impossible one is reported, the end is that of a simulation."""

import itertools
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from support.asserting import not_none
from support.meshes import block_with_bone, with_skin
from support.small_case import part_case
from support.small_trunk import APEX, small_case, small_patient
from warp_trunk.bone_motion.plan import PlannedSurgery
from warp_trunk.bone_motion.prescribed_motion import rigid_path
from warp_trunk.case.motions import Motion
from warp_trunk.engine.build import build_model
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.geometry.rigid import RigidMotion
from warp_trunk.geometry.surface import Surface
from warp_trunk.live import relaxation
from warp_trunk.live import session as session_of_page
from warp_trunk.live.relaxation import Interrupted, LiveRelaxation, Relaxed
from warp_trunk.live.session import Latest, PlanView, Session
from warp_trunk.live.sliders import (
    KYPHOSIS,
    LIV,
    UIV,
    MotionSliders,
    Setting,
    Sliders,
    SliderState,
    SpineSliders,
    first_state,
    with_handles,
)
from warp_trunk.measures import measure
from warp_trunk.measures.quantities import Measured
from warp_trunk.meshing import MeshOptions
from warp_trunk.run.intervals import find_bands
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.patient import PreparedPatient, patient_of
from warp_trunk.run.prediction import Prediction, prepare_plan

WAIT = 60.0


class Heard(Session):
    """A session that records what it shows, in order."""

    def __init__(self, patient: PreparedPatient, sliders: Sliders | None = None) -> None:
        self.sliders = sliders or SpineSliders(patient.case)
        self.told: list[PlanView | None] = []
        self.words: list[str] = []
        self.faults: list[str] = []
        self._more = threading.Condition()
        super().__init__(patient, self.sliders, self._hear, self.faults.append)

    def _hear(self) -> None:
        with self._more:
            self.told.append(self.view)
            self.words += [self.refusal, self.intervals, self.doing]
            self._more.notify_all()

    def until(self, wanted: Callable[[], object]) -> None:
        with self._more:
            assert self._more.wait_for(wanted, WAIT), self.told[-1:]

    def settled(self, state: SliderState) -> PlanView:
        """The view of a state of the sliders, relaxed to the end and measured."""
        self.ask(state)
        self.until(lambda: (v := self.view) and v.state == state and v.settled and v.measures is not None)
        assert self.view is not None
        return self.view

    def corrected(self, share: int) -> SliderState:
        return {**first_state(self.sliders), Setting("correction", APEX): share}


@pytest.fixture(scope="module")
def patient() -> PreparedPatient:
    return small_patient()


@pytest.fixture(autouse=True)
def soon_at_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sliders rest sooner than those of a hand."""
    monkeypatch.setattr(session_of_page, "REST", 0.05)


def wait_for(filled: list, count: int = 1) -> None:
    """Waits until another thread has put something into a list."""
    end = time.monotonic() + WAIT
    while len(filled) < count and time.monotonic() < end:
        time.sleep(0.01)


def check_end(view: PlanView, alone: PreparedPatient) -> np.ndarray:
    """The view of a plan is that of a simulation on its own; returns how that moves the nodes."""
    planned = view.surgery.planned_case(alone.case)
    prediction = prepare_plan(alone, planned).relax()
    skin, last = prediction.skin, prediction.last
    tolerance = alone.options.simulation.relax.tolerance
    assert view.error is not None
    assert view.error <= tolerance
    assert np.linalg.norm(view.skin - skin.vertices, axis=1).max() <= 2.0 * tolerance
    assert np.linalg.norm(skin.vertices - planned.skin.vertices, axis=1).max() > 2.0  # it went somewhere
    if isinstance(view.surgery, PlannedSurgery):
        assert view.measures is not None
        for level, angle in measure(skin, planned.planned_landmarks, planned.skin).bsr.items():
            assert view.measures.bsr[level] == pytest.approx(angle, abs=0.05)
    return last.displacement


@pytest.mark.parametrize("bones", ["follow", "spline"])
def test_after_any_way_the_end_is_that_of_a_simulation(bones: str) -> None:
    with Heard(small_patient(bones=bones)) as session:
        for share in (60, 45):
            view = session.settled(session.corrected(share))
    alone = small_patient(bones=bones)
    displacement = check_end(view, alone)
    if bones == "follow":  # drawn where the simulation holds them
        on_bone = alone.trunk.nodes[alone.trunk.prescribed]
        moved = on_bone + displacement[alone.trunk.prescribed]
        np.testing.assert_allclose(view.motions["T8"].apply(on_bone), moved, atol=1e-4)
    assert session.faults == []


def test_the_end_of_motions_is_that_of_a_simulation_and_a_collision_is_refused() -> None:
    case = part_case(front=Motion(translation=(0.0, -4.0, 0.0)), left=Motion(follows={"front": 0.5}))
    options = RunOptions(mesh=MeshOptions(tets=5000, bone_voxel=5.0))
    execution = Execution(device="cpu", threads=1, cache=False)
    handled = with_handles(case)
    patient = patient_of(handled, options, execution=execution)
    with Heard(patient, MotionSliders(handled)) as session:
        state = first_state(session.sliders)
        session.settled(state)
        session.ask({**state, Setting("Back mm", "front"): 35.0})
        session.until(lambda: session.refusal.startswith("'front' passes"))
        view = session.settled({**state, Setting("Back mm", "front"): -7.0, Setting("Up mm", "front"): 1.0})
    check_end(view, patient_of(case, options, patient.trunk, execution=execution))
    assert session.faults == []


def test_a_drag_shows_images_and_skips_what_is_no_longer_wished(patient: PreparedPatient) -> None:
    with Heard(patient) as session:
        for share in range(1, 60):
            session.ask(session.corrected(share))
            time.sleep(0.0005)
        end = session.settled(session.corrected(60))
    views = [view for view in session.told if view is not None]
    numbers = [view.number for view in views]
    assert numbers == sorted(numbers)  # never an older one after a newer one
    assert end.number < 60  # planning took longer than the way of the slider: some were skipped
    first = next(view for view in views if view.number == end.number)
    assert not first.relaxed
    off = np.linalg.norm(first.skin - end.skin, axis=1).max()
    assert first.error is None or off <= 3.0 * first.error + 0.1  # it says about how far off it is
    after = views[next(i for i, view in enumerate(views) if view.relaxed) :]
    assert all(view.error is not None for view in after)  # images learn from the first relaxation on
    relaxed = [view for view in views if view.relaxed and not view.settled]
    assert relaxed
    assert all(view.error is not None and view.error <= 1.0 for view in relaxed)


def test_a_newer_wish_ends_a_relaxation_that_takes_long(
    patient: PreparedPatient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A state far away whose relaxation never ends by itself, then undo."""
    relax = LiveRelaxation.relax

    def endless(
        tissue: LiveRelaxation, tolerance: float, *, confirm: bool, newer: Callable[[], bool], report: object
    ) -> Relaxed:
        while np.abs(tissue._carried).max() > 12.0:
            time.sleep(0.01)
            if newer():
                raise Interrupted
        return relax(tissue, tolerance, confirm=confirm, newer=newer)

    monkeypatch.setattr(LiveRelaxation, "relax", endless)
    with Heard(patient) as session:
        near, far = session.corrected(10), session.corrected(95)
        session.settled(near)
        session.ask(far)
        assert session.planning or getattr(session.view, "state", None) == far
        session.until(lambda: getattr(session.view, "state", None) == far)
        assert session.view is not None
        assert not session.view.relaxed
        session.settled(near)
        assert not session.planning


def test_an_impossible_wish_is_reported_and_the_next_one_clears_it(patient: PreparedPatient) -> None:
    with Heard(patient) as session:
        session.settled(session.corrected(30))
        session.ask({**session.corrected(100), UIV: "L4", LIV: "T4"})
        session.until(lambda: session.refusal)
        assert session.refusal.startswith(
            "the upper vertebra must lie above the lower one, but L4 is not above T4"
        )
        session.settled(session.corrected(31))
        assert session.refusal == ""


def test_threads_of_linear_algebra_are_limited_while_it_runs(
    patient: PreparedPatient, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = list[object]()
    limits = SimpleNamespace(restore_original_limits=lambda: calls.append("restored"))
    monkeypatch.setattr(session_of_page, "threadpool_limits", lambda count: calls.append(count) or limits)
    with Heard(patient):
        assert calls == [1]
    assert calls == [1, "restored"]


def test_a_fault_of_the_program_is_reported(patient: PreparedPatient, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("as if")

    with Heard(patient) as session:
        monkeypatch.setattr(session.sliders, "surgery", broken)
        session.ask(session.corrected(1))
        wait_for(session.faults)
    assert session.faults == ["ZeroDivisionError: as if"]


def test_other_plans_are_relaxed_beside_that_of_the_sliders_one_after_the_other(patient: PreparedPatient) -> None:
    beside: list[PlanView] = []
    with Heard(patient) as session:
        states = [session.corrected(share) for share in (50, 30)]
        session.settled(session.corrected(10))
        for state in states:
            session.relax_beside(SpineSliders(patient.case).surgery(state), beside.append)
        wait_for(beside, 2)
        alone = [session.settled(state) for state in states]
    tolerance = patient.options.simulation.relax.tolerance
    for view, own in zip(beside, alone, strict=True):
        assert view.settled
        assert view.measures is not None
        assert np.linalg.norm(view.skin - own.skin, axis=1).max() <= 2.0 * tolerance
    assert session.faults == []


@pytest.mark.parametrize("limit", ["FAR_WISH", "MOST_ITERATIONS"])
def test_a_wish_far_away_is_predicted_as_simulate_does_and_says_so(
    limit: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No iteration is spent on the way straight there."""
    monkeypatch.setattr(relaxation, limit, -1)
    monkeypatch.setattr(relaxation, "FEW_INVERTED", 0.0)
    said = list[str]()
    patient = small_patient()
    tissue = LiveRelaxation(patient)
    planned = SpineSliders(patient.case).surgery(
        {**first_state(SpineSliders(patient.case)), Setting("correction", APEX): 60}
    )
    case = planned.planned_case(patient.case)
    tissue.go(case)
    predicted = tissue.relax(1.0, confirm=False, newer=lambda: False, report=said.append)
    count = patient.options.simulation.increments
    assert all("from before surgery, as the plan is far" in line for line in said)
    parts = [line.partition(" from")[0] for line in said]
    assert list(dict.fromkeys(parts)) == [f"part {number} of {count}" for number in range(1, count + 1)]
    alone = prepare_plan(small_patient(), case).relax()
    np.testing.assert_allclose(predicted.skin, alone.skin.vertices, atol=1e-4)
    assert tissue.relax(0.1, confirm=True, newer=lambda: False) is predicted


@pytest.mark.slow
def test_intervals_are_those_of_a_simulation(patient: PreparedPatient) -> None:
    with Heard(patient) as session:
        view = session.settled(session.corrected(40))
        session.ask_for_intervals()
        session.until(lambda: session.view is not None and session.view.intervals)
        rows = {(row.state, row.quantity, row.level): row for row in not_none(session.view).intervals}
    alone = prepare_plan(small_patient(), view.surgery.planned_case(patient.case)).relax()
    for row in find_bands(alone).rows:
        if row.state == "predicted" and row.quantity in ("bsr_deg", "cobb_deg"):
            assert rows[row.state, row.quantity, row.level].sd == pytest.approx(row.sd, rel=0.05, abs=0.02)


def test_intervals_are_asked_of_the_plan_that_is_shown(
    patient: PreparedPatient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are computed once, for the skin of that plan where it came to rest, and gone with the next plan."""
    asked, rows = list[Prediction](), (Measured("predicted", "T8", "bsr_deg", 1.0),)

    def bands(prediction: Prediction) -> SimpleNamespace:
        asked.append(prediction)
        return SimpleNamespace(rows=rows)

    monkeypatch.setattr(relaxation, "find_bands", bands)
    with Heard(patient) as session:
        session.ask_for_intervals()
        view = session.settled(session.corrected(40))
        assert view.intervals == ()
        session.ask_for_intervals()
        session.until(lambda: session.view is not None and session.view.intervals)
        assert (not_none(session.view).intervals, session.intervals) == (rows, "")
        session.settled(session.corrected(10))
        assert not_none(session.view).intervals == ()
    assert {session_of_page.WAITING_FOR_REST, session_of_page.COMPUTING, "step 1"} <= set(session.words)
    (prediction,) = asked
    np.testing.assert_allclose(prediction.skin.vertices, view.skin, atol=1e-4)
    after = prediction.case.planned_landmarks.points
    np.testing.assert_allclose(after, view.surgery.landmarks_after.points)


def test_with_any_other_slider_the_plan_is_made_again_and_its_intervals_go(
    patient: PreparedPatient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A control that is new is tried, too; relaxing is left out."""
    skins = itertools.count(1.0)

    def relaxed(tissue: LiveRelaxation, *_: object, **__: object) -> Relaxed:
        skin = tissue._patient.case.skin.vertices + next(skins)
        return Relaxed(skin, 0.01, RelaxStatus.CONVERGED, ())

    rows = [Measured("predicted", "T8", "bsr_deg", 1.0)]
    monkeypatch.setattr(LiveRelaxation, "relax", relaxed)
    monkeypatch.setattr(LiveRelaxation, "prepare", lambda _: None)
    monkeypatch.setattr(LiveRelaxation, "intervals", lambda _: rows)
    monkeypatch.setattr(session_of_page, "REST", 0.0)
    tried = 0
    with Heard(patient) as session:
        for control, setting in session.sliders.controls.items():
            state = session.corrected(40)
            first = session.settled(state)
            session.ask_for_intervals()
            session.until(lambda: not_none(session.view).intervals)
            values = [*(setting.choices or range(int(setting.span[0]), int(setting.span[1]) + 1))]
            other = values[values.index(state[control]) - 1] if state[control] != values[0] else values[1]
            changed = {**state, control: other}
            session.ask(changed)
            session.until(
                lambda to=changed: session.refusal or ((v := session.view) and v.state == to and v.settled)
            )
            view = not_none(session.view)
            if not session.refusal:
                tried += 1
                assert (view.intervals, view.number) == ((), first.number + 1), control
                assert (view.skin != first.skin).any(), control
    assert tried >= 4
    assert session.faults == []


def test_a_plan_that_is_relaxed_to_the_end_warns_as_a_simulation_does(
    patient: PreparedPatient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a kyphosis of 50 degrees, and of skin that is stretched, as soon as any is."""
    monkeypatch.setattr("warp_trunk.measures.skin_quality.STRETCH", 1.0)
    monkeypatch.setattr("warp_trunk.measures.skin_quality.AREA", 0.0)
    with Heard(patient) as session:
        view = session.settled({**session.corrected(20), KYPHOSIS: 50})
    assert [w for w in view.warnings if w.startswith("Kyphosis T5 to T12: ends at 50 degrees, 10 to 40 is normal")]
    assert [w for w in view.warnings if w.startswith("The predicted skin is stretched to more than")]


def test_warnings_of_the_plan_are_shown_from_its_image_on(
    patient: PreparedPatient, monkeypatch: pytest.MonkeyPatch
) -> None:
    sources = ("curve_warnings", "endplate_warnings", "flexibility_warnings")
    for source in sources:
        monkeypatch.setattr(session_of_page, source, lambda *_, source=source: [f"A sentence of {source}."])
    with Heard(patient) as session:
        session.settled(session.corrected(20))
    views = [shown for shown in session.told if shown is not None]
    assert {shown.relaxed for shown in views} == {False, True}
    for shown in views:
        assert {f"A sentence of {source}." for source in sources} <= set(shown.warnings)


def test_the_latest_is_taken_and_the_end_wakes_who_waits() -> None:
    place: Latest[int] = Latest()
    for value in range(1, 100):
        place.put(value)
    assert place.waits
    assert place.take() == 99
    assert not place.comes(0.0)
    taken: list[int | None] = [0]
    thread = threading.Thread(target=lambda: taken.append(place.take()))
    thread.start()
    place.close()
    thread.join(10.0)
    assert taken == [0, None]
    place.put(1)
    assert place.take() is None  # what was not taken before the end is not done


def test_tissue_comes_off_bones_as_in_a_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two bones pass through each other, as in `tests/run/test_prediction.py`."""
    trunk = with_skin(block_with_bone((5, 5, 5), 8.0, holes=((1, 2, 2), (3, 2, 2))))
    motions = {
        "bone 0": RigidMotion.identity(),
        "bone 1": RigidMotion(np.eye(3), np.array([-10.0, 0.0, 0.0])),
    }
    case = replace(small_case()[0], skin=Surface(trunk.nodes[trunk.skin_nodes], trunk.skin_faces))
    options = RunOptions(simulation=SimulationOptions(increments=2))
    patient = PreparedPatient(case, options, Execution(), trunk, build_model(trunk, device="cpu"))
    monkeypatch.setattr(PreparedPatient, "path_of", lambda *_: rigid_path(trunk, motions))
    monkeypatch.setattr(relaxation, "motions_of", lambda *_: motions)
    tissue = LiveRelaxation(patient)
    tissue.go(case)
    with monkeypatch.context() as patch:
        patch.setattr(relaxation, "FEW_INVERTED", 1.0)
        patch.setattr(relaxation, "MOST_ITERATIONS", 10_000)
        moving = tissue.relax(1.0, confirm=False, newer=lambda: False)
    assert (moving.status, moving.warnings) == (RelaxStatus.NEAR, (relaxation.PINCHED,))
    released = tissue.relax(1.0, confirm=False, newer=lambda: False)  # too many to leave them
    relaxed = tissue.relax(0.1, confirm=True, newer=lambda: False)
    simulated = Prediction(patient, case, rigid_path(trunk, motions)).relax()
    assert simulated.released > 0
    np.testing.assert_array_equal(relaxed.skin, simulated.skin.vertices)
    assert relaxed.warnings[0].startswith("Tissue comes off the bones at ")
    assert tissue.relax(0.1, confirm=True, newer=lambda: False) is relaxed
    assert released is relaxed
