"""The file of a plan, plan.toml, and the case folder that a plan makes."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from warp_trunk.case import Case, write_case
from warp_trunk.case.case_folder import begin_case
from warp_trunk.case.folders import is_case, refuse_case
from warp_trunk.checking import checked
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import json_text, write_whole
from warp_trunk.io.file_access import check_place, parsed_number, read_text
from warp_trunk.io.file_names import name_of
from warp_trunk.io.records import as_record, toml_table, toml_text
from warp_trunk.io.result_files import MOST_PLAN, PLAN

from .record import CurvePlan, Plan, targets_of_text
from .surgery import PlannedSurgery, surgery_record


@checked
def read_plan(path: str | Path) -> Plan:
    """Read a plan.toml.

    >>> wt.write_plan(folder / "plan.toml", wt.Plan(uiv="T4", liv="L1"))
    >>> wt.read_plan(folder / "plan.toml").liv
    'L1'

    Raises:
        InputError: a missing or unreadable file, an unknown key (the nearest known one is named), a value of the
            wrong type or one that is not allowed.
    """
    path = Path(path)
    return plan_of_text(read_text(path, "a plan is given as TOML; see docs/planning.md", MOST_PLAN), path)


def plan_of_text(text: str, path: Path) -> Plan:
    """The plan of a text in TOML; errors name the path, see `read_plan`."""
    return as_record(toml_table(text, path), Plan, path)


def plan_in(text: str | None) -> Plan | None:
    """The plan that made landmarks after surgery, of its text; None where none did."""
    return None if text is None else plan_of_text(text, Path(PLAN))


def curve_of_text(text: str) -> CurvePlan:
    """One curve as the command line has it: T8,correction=0.65,derotation=0.4.

    Raises:
        InputError: a key that is not known, or a value that is no number or is not allowed.
    """
    apex, targets = targets_of_text("--curve", text, parsed_number, "a number, as correction=0.65")
    return as_record({"apex": apex, **targets}, CurvePlan, f"--curve {text}")


def plan_text(plan: Plan) -> str:
    """The text of a plan.toml that `read_plan` reads back to the last bit."""
    record = dataclasses.asdict(plan)
    return toml_text(record | {"curve": record.pop("curves")})


@checked
def write_plan(path: str | Path, plan: Plan) -> None:
    """Write a plan.toml.

    >>> wt.write_plan(folder / "fused.toml", wt.Plan(uiv="T4", liv="L1"))
    """
    check_place(Path(path))
    write_whole(Path(path), plan_text(plan))


RECORD = "plan.json"
"""File of a planned case beside those of a case and its plan."""
_CORRECTION = re.compile(r"(, [\d.]+ % corrected)?(, plan .*)?$")
"""The correction in the name of a case that a plan replaces: one of `make-case`, or a plan's."""


def write_planned_case(folder: Path, case: Case, surgery: PlannedSurgery, name: str | None = None) -> Case:
    """Write the case after a surgery, with the plan that makes it again and what it asks of each vertebra.

    `case.toml` is written last: a folder that has one is whole.

    Args:
        folder: where to.
        case: the patient.
        surgery: the surgery.
        name: what the plan is called; the name of the folder when left out.

    Returns:
        What was written.

    Raises:
        InputError: as `check_planned_folder` and `write_case`.
    """
    check_planned_folder(folder)
    planned = planned_case(case, surgery, name or name_of(folder.resolve()))
    begin_case(folder)
    write_plan(folder / PLAN, surgery.plan)
    write_whole(folder / RECORD, json_text(surgery_record(surgery)))
    write_case(folder, planned)
    return planned


def planned_case(case: Case, surgery: PlannedSurgery, name: str) -> Case:
    """The case after a surgery, named after the patient and the plan, so that plans for one patient differ."""
    name = f"{patient_name(case)}, plan {name}"
    return replace(surgery.planned_case(case), name=name, plan_text=plan_text(surgery.plan))


def patient_name(case: Case) -> str:
    """The name of a case without the correction or the plan that it may name."""
    return _CORRECTION.sub("", case.name)


def written_plan(folder: Path) -> str | None:
    """The text of the plan that a folder holds."""
    path = folder / PLAN
    return read_text(path, "the plan of a case", MOST_PLAN) if path.exists() else None


def check_planned_folder(folder: Path, case: Path | None = None) -> None:
    """Raise InputError where a planned case would take the place of a case that no plan wrote, or lie in one."""
    if is_case(folder) and not (folder / PLAN).exists():
        same = case is not None and folder.resolve() == case.resolve()
        what = "is the case itself" if same else "holds another case"
        raise InputError(f"{folder}: {what}, which a plan does not overwrite; give --out a folder of its own")
    refuse_case(folder.resolve().parent)


def plan_files(paths: Sequence[Path]) -> dict[str, Path]:
    """The files of plans by what to call each: after its file, or where that is plan.toml, after its folder.

    Args:
        paths: files, or folders with a plan.toml, such as planned cases.

    Raises:
        InputError: two that are called the same.
    """
    files: dict[str, Path] = {}
    for path in paths:
        file = path / PLAN if path.is_dir() else path
        name = file.resolve().parent.name if file.name == PLAN else file.stem
        if name in files:
            raise InputError(
                f"--plan {path}: a plan is called after its file, or its folder where that is {PLAN}, and "
                f"{files[name]} is called '{name}' too; give each plan once, under a name of its own"
            )
        files[name] = file
    return files
