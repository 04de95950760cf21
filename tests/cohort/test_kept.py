"""A finished case of a cohort is done again where anything changes on which its row depends, and only there.

The things are the fields of the records; a new field fails until it is decided here.
"""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.changed_cases import (
    CASE,
    CHANGES,
    EXECUTION,
    EXECUTION_WITHOUT,
    OPTIONS,
    RUN,
    RUN_ELSEWHERE,
)
from support.cohort_cases import turned_case
from warp_trunk.case import Case, write_case
from warp_trunk.case.fingerprint import difference
from warp_trunk.cli.arguments import parse_command
from warp_trunk.cli.cohort import Cohort
from warp_trunk.cohort import one_case
from warp_trunk.cohort.one_case import CohortOptions
from warp_trunk.errors import InputError
from warp_trunk.run.options import Execution, RunOptions


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


def test_each_case_has_one_thread_unless_more_are_asked_for() -> None:
    for flags, threads in (([], 1), (["--threads", "3"], 3)):
        command = parse_command(Cohort, ["cohort", "cases", "--out", "out", *flags])
        assert command.of_each.execution.threads == threads


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
        command = parse_command(Cohort, ["cohort", str(tmp_path), "--out", str(tmp_path / "out"), *flags])
        outcome = one_case.do_case(tmp_path / "case", tmp_path / "out", command.of_each)
        assert outcome.row.reason == "seen"
    away_from_pelvis = [
        case.planned_landmarks.point("asis_left") - case.landmarks_before.point("asis_left") for case in seen
    ]
    np.testing.assert_allclose(away_from_pelvis, [[3.0, 0.0, 0.0], [0.0, 0.0, 0.0]], atol=1e-2)
