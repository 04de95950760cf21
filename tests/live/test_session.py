"""From wishes to views: the latest wins, an impossible one is reported, and the end is that of a simulation."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from support.small_patient import small_patient
from warp_trunk.engine.simulation import simulate
from warp_trunk.live.session import LateMeasures, PlanView, Refusal, Session
from warp_trunk.live.wish import Wish, first_wish, spine_before
from warp_trunk.measures import measure
from warp_trunk.results import predicted_skin
from warp_trunk.run.patient import Patient, prepare_plan

WAIT = 60.0


class Heard:
    """The views of a session, in order."""

    def __init__(self) -> None:
        self.told: list[PlanView | Refusal | LateMeasures] = []
        self.faults: list[str] = []
        self._more = threading.Condition()

    def __call__(self, told: PlanView | Refusal | LateMeasures) -> None:
        with self._more:
            self.told.append(told)
            self._more.notify_all()

    def until(
        self, wanted: Callable[[PlanView | Refusal | LateMeasures], bool]
    ) -> PlanView | Refusal | LateMeasures:
        """The first matching view, waiting for it."""
        with self._more:
            assert self._more.wait_for(lambda: any(map(wanted, self.told)), WAIT), self.told[-1:]
            return next(filter(wanted, self.told))

    def settled(self, wish: Wish) -> PlanView:
        """The view of a wish, relaxed to the end and measured."""
        view = self.until(
            lambda told: (
                isinstance(told, PlanView) and told.wish == wish and told.settled and told.measures is not None
            )
        )
        assert isinstance(view, PlanView)
        return view


@pytest.fixture(scope="module")
def patient() -> Patient:
    return small_patient()


@pytest.fixture(scope="module")
def rest(patient: Patient) -> Wish:
    return first_wish(spine_before(patient.case.landmarks_before))


def corrected(rest: Wish, share: int) -> Wish:
    apex = next(apex for apex in rest.correction if rest.fuses(apex))
    return replace(rest, correction={**rest.correction, apex: share})


@pytest.mark.parametrize("bones", ["follow", "spline"])
def test_after_any_way_the_end_is_that_of_a_simulation(bones: str, rest: Wish) -> None:
    heard, patient = Heard(), small_patient(bones=bones)
    with Session(patient, None, heard, heard.faults.append) as session:
        for share in (60, 20, 45):
            session.ask(corrected(rest, share))
            view = heard.settled(corrected(rest, share))
    alone = small_patient(bones=bones)
    case = view.surgery.planned_case(alone.case)
    *_, last = simulate(alone.model, prepare_plan(alone, case).bone_path, alone.options.simulation)
    if view.motions is not None:  # drawn where the simulation holds them
        here = alone.trunk.nodes[alone.trunk.prescribed]
        there = here + last.displacement[alone.trunk.prescribed]
        np.testing.assert_allclose(view.motions["T8"].apply(here), there, atol=1e-4)
    assert (view.motions is None) == (bones == "spline")
    skin = predicted_skin(case, alone.trunk, last.displacement)
    tolerance = alone.options.simulation.relax.tolerance
    assert view.error is not None
    assert view.error <= tolerance
    assert np.linalg.norm(view.skin - skin.vertices, axis=1).max() <= 2.0 * tolerance
    assert np.linalg.norm(skin.vertices - case.skin.vertices, axis=1).max() > 2.0  # it went somewhere
    wanted = measure(skin, case.planned_landmarks, case.skin)
    assert view.measures is not None
    for level, angle in wanted.bsr.items():
        assert view.measures.bsr[level] == pytest.approx(angle, abs=0.05)
    assert heard.faults == []


def test_a_drag_shows_images_and_skips_what_is_no_longer_wished(patient: Patient, rest: Wish) -> None:
    heard = Heard()
    with Session(patient, None, heard, heard.faults.append) as session:
        for share in range(1, 61):
            session.ask(corrected(rest, share))
            time.sleep(0.0005)
        end = heard.settled(corrected(rest, 60))
    numbers = [told.number for told in heard.told if isinstance(told, PlanView)]
    assert numbers == sorted(numbers)  # never an older one after a newer one
    assert end.number < 60  # planning took longer than the way of the slider: some were skipped
    first = next(told for told in heard.told if isinstance(told, PlanView) and told.number == end.number)
    assert not first.relaxed
    off = np.linalg.norm(first.skin - end.skin, axis=1).max()
    assert first.error is None or off <= 3.0 * first.error + 0.1  # it says about how far off it is
    relaxed = [told for told in heard.told if isinstance(told, PlanView) and told.relaxed and not told.settled]
    assert relaxed
    assert all(told.error is not None and told.error <= 1.0 for told in relaxed)


def test_numbers_follow_a_drag_that_does_not_rest(patient: Patient, rest: Wish) -> None:
    """A relaxed skin is measured also where the sliders have moved on since."""
    heard = Heard()
    with Session(patient, None, heard, heard.faults.append) as session:
        until = time.monotonic() + WAIT
        share = 0
        while not any(isinstance(told, LateMeasures) for told in list(heard.told)) and time.monotonic() < until:
            session.ask(corrected(rest, share := share % 60 + 1))
            time.sleep(0.005)
    measured = next(told for told in heard.told if isinstance(told, LateMeasures))
    assert measured.measures.skin_change_max is not None
    assert heard.faults == []


def test_an_impossible_wish_is_told_and_the_next_one_goes_on(patient: Patient, rest: Wish) -> None:
    heard = Heard()
    never = replace(corrected(rest, 100), uiv="L4", liv="T4")
    with Session(patient, None, heard, heard.faults.append) as session:
        session.ask(corrected(rest, 30))
        heard.settled(corrected(rest, 30))
        session.ask(never)
        refusal = heard.until(lambda told: isinstance(told, Refusal))
        assert isinstance(refusal, Refusal)
        assert refusal.reason.startswith("'uiv' must lie above 'liv', but L4 is not above T4")
        session.ask(corrected(rest, 31))
        heard.settled(corrected(rest, 31))


def test_a_fault_of_the_program_is_told(patient: Patient, monkeypatch: pytest.MonkeyPatch, rest: Wish) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("as if")

    monkeypatch.setattr("warp_trunk.live.session.Planner.plan", broken)
    faults: queue.Queue[str] = queue.Queue()
    with Session(patient, None, Heard(), faults.put) as session:
        session.ask(rest)
        assert faults.get(timeout=WAIT) == "ZeroDivisionError: as if"


def test_another_plan_is_relaxed_beside_that_of_the_sliders(patient: Patient, rest: Wish) -> None:
    heard, beside = Heard(), []
    wish = corrected(rest, 50)
    with Session(patient, None, heard, heard.faults.append) as session:
        session.ask(corrected(rest, 10))
        heard.settled(corrected(rest, 10))
        session.look_at(wish.plan(), wish, beside.append)
        assert [view.relaxed for view in beside] == [False]
        until = time.monotonic() + WAIT
        while len(beside) < 2 and time.monotonic() < until:
            time.sleep(0.01)
        session.ask(wish)
        alone = heard.settled(wish)
    assert beside[1].settled
    assert beside[1].measures is not None
    tolerance = patient.options.simulation.relax.tolerance
    assert np.linalg.norm(beside[1].skin - alone.skin, axis=1).max() <= 2.0 * tolerance
    assert heard.faults == []
