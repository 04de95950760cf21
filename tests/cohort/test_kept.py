"""A finished case of a cohort is done again where anything changes on which its row depends, and only there.

The things are the fields of the records; a new field fails until it is decided here.
"""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.cohort_cases import cohort_options, turned_case
from warp_trunk.case import Case, write_case
from warp_trunk.case.fingerprint import difference
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.layers import Layers
from warp_trunk.case.motions import Motion
from warp_trunk.case.points import Points
from warp_trunk.case.rib_coupling import RibCoupling
from warp_trunk.case.uncertainty import Invented, Uncertainty
from warp_trunk.cli.arguments import parse
from warp_trunk.cli.cohort import Cohort
from warp_trunk.cohort import one_case
from warp_trunk.cohort.one_case import CohortOptions
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.run.options import Execution, RunOptions

CASE, OPTIONS = turned_case("first", 1.0), cohort_options()


def moved(surface: Surface) -> Surface:
    return surface.moved(surface.vertices + np.array([0.01, 0.0, 0.0]))


def shifted(marks: Landmarks) -> Landmarks:
    return replace(marks, points=marks.points + np.array([0.01, 0.0, 0.0]))


def changed(record: Any) -> list[Any]:
    """The record with each of its numbers changed."""
    return [replace(record, **{f.name: 0.99 * getattr(record, f.name) or 0.01}) for f in fields(record)]


CHANGES: dict[str, list[Any]] = {
    "name": ["other"],
    "skin": [moved(CASE.skin)],
    "bones": [CASE.bones | {"T7": moved(CASE.bones["T7"])}],
    "landmarks_before": [shifted(CASE.landmarks_before)],
    "landmarks_after": [shifted(CASE.planned_landmarks)],
    "actual_skin": [moved(CASE.actual_skin or CASE.skin), None],
    "tissue": changed(CASE.tissue),
    "bones_after": [{"T7": moved(CASE.bones["T7"])}],
    "layers": [Layers(skin_thickness=1.5)],
    "rib_coupling": changed(RibCoupling()),
    "uncertainty": changed(Uncertainty()),
    "study": [replace(CASE.study, patient="P9"), replace(CASE.study, pose="bending"),
              replace(CASE.study, months_after=3.0), replace(CASE.study, synthetic=not CASE.study.synthetic)],
    "plan": ["uiv = 'T4'"],
    "posture": ["supine"],
    "invented": [Invented(), Invented(share=0.4)],
    "unseen": [np.ones(len(CASE.skin.vertices), dtype=bool)],
    "bending_left": [CASE.landmarks_before],
    "bending_right": [CASE.landmarks_before],
    "points": [Points(CASE.landmarks_before), Points(CASE.landmarks_before, {"a": "b"})],
    "notes": [("The skin was repaired.",)],
    "motions": [{"T7": Motion(translation=(1.0, 0.0, 0.0))}],
}  # fmt: skip
"""Other values of each field of a case: its result, which is kept with its row, depends on all."""


def inputs(case: Case, options: CohortOptions = OPTIONS) -> Any:
    return one_case._made_from(case, options)


def test_every_field_of_a_case_is_decided() -> None:
    assert {field.name for field in fields(Case)} == CHANGES.keys()


@pytest.mark.parametrize("field", CHANGES)
def test_a_change_of_the_case_makes_it_be_done_again(field: str) -> None:
    assert CHANGES[field]
    for value in CHANGES[field]:
        assert difference(inputs(CASE), inputs(replace(CASE, **{field: value}))), value


def test_the_same_case_is_kept() -> None:
    assert difference(inputs(CASE), inputs(turned_case("first", 1.0))) == ""


RUN: dict[str, Any] = {
    "mesh": replace(OPTIONS.run.mesh, tets=9000), "simulation": replace(OPTIONS.run.simulation, increments=2),
    "energy": "itmsm", "weights": "volume", "skin_rigidity": 0.1, "precision": "float64", "gravity": 9.81,
    "alpha": 0.1, "rest": "scan", "layers": "depth", "bones": "spline", "bands": True, "from_mesh": Path("a.vtu"),
}  # fmt: skip
RUN_ELSEWHERE = {"constants": "in the tissue of the case"}
EXECUTION: dict[str, Any] = {"device": "cuda:0", "threads": 2}
EXECUTION_WITHOUT = {"cache", "record", "view", "yes"}
"""They change no number."""


def test_every_option_is_decided() -> None:
    assert {field.name for field in fields(RunOptions)} == RUN.keys() | RUN_ELSEWHERE.keys()
    assert {field.name for field in fields(Execution)} == EXECUTION.keys() | EXECUTION_WITHOUT


@pytest.mark.parametrize("option", RUN)
def test_another_option_makes_it_be_done_again(option: str) -> None:
    asked = replace(OPTIONS.run, **{option: RUN[option]})
    other = OPTIONS.__class__.__new__(OPTIONS.__class__)  # also one that a cohort refuses
    object.__setattr__(other, "run", asked)
    object.__setattr__(other, "execution", OPTIONS.execution)
    assert difference(inputs(CASE), inputs(CASE, other))


def test_another_device_or_number_of_threads_makes_it_be_done_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(one_case, "choose_device", lambda device: device)
    for option, value in EXECUTION.items():
        execution = replace(OPTIONS.execution, **{option: value})
        assert difference(inputs(CASE), inputs(CASE, replace(OPTIONS, execution=execution))), option
    for option in EXECUTION_WITHOUT - {"view"}:
        execution = replace(OPTIONS.execution, **{option: not getattr(OPTIONS.execution, option)})
        assert not difference(inputs(CASE), inputs(CASE, replace(OPTIONS, execution=execution))), option


def test_the_case_of_a_cohort_is_aligned_where_that_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Surgery data in another frame: with --align-pelvis the pelvis comes back to where it was."""
    seen: list[Case] = []

    def stopped(case: Case, *_: Any, **__: Any) -> None:
        seen.append(case)
        raise InputError("seen")

    away = CASE.planned_landmarks.points + np.array([3.0, 0.0, 0.0])
    write_case(tmp_path / "case", replace(CASE, landmarks_after=replace(CASE.planned_landmarks, points=away)))
    monkeypatch.setattr(one_case, "simulate", stopped)
    for flags in ([], ["--align-pelvis"]):
        command = parse(Cohort, ["cohort", str(tmp_path), "--out", str(tmp_path / "out"), *flags])
        outcome = one_case.do_case(tmp_path / "case", tmp_path / "out", command.of_each)
        assert outcome.row.reason == "seen"
    away_from_pelvis = [
        case.planned_landmarks.point("asis_left") - case.landmarks_before.point("asis_left") for case in seen
    ]
    np.testing.assert_allclose(away_from_pelvis, [[3.0, 0.0, 0.0], [0.0, 0.0, 0.0]], atol=1e-2)
