"""The case folder that a plan makes, and what plans are called."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from warp_trunk.case import write_case
from warp_trunk.case.case_writer import HEADER, refuse_case
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import atomic_write

from .plan_file import write_plan
from .surgery_text import surgery_record

if TYPE_CHECKING:
    from warp_trunk.case import Case

    from .surgery import PlannedSurgery

PLAN, RECORD = "plan.toml", "plan.json"
"""What a planned case holds beside the files of a case."""
_CORRECTION = re.compile(r"(, [\d.]+ % corrected)?(, plan .*)?$")
"""What the name of a case says of the correction that a plan replaces: one of `make-case`, or a plan's."""


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
    planned = planned_case(case, surgery, name or folder.resolve().name)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / HEADER).unlink(missing_ok=True)
    write_plan(folder / PLAN, surgery.plan)
    with atomic_write(folder / RECORD) as unfinished:
        text = json.dumps(surgery_record(surgery), indent=2, allow_nan=False)
        unfinished.write_text(text + "\n", encoding="utf-8")
    write_case(folder, planned)
    return planned


def planned_case(case: Case, surgery: PlannedSurgery, name: str) -> Case:
    """The case after a surgery, called by the patient and the plan: plans for one patient are told apart."""
    patient = _CORRECTION.sub("", case.name)
    return replace(surgery.planned_case(case), name=f"{patient}, plan {name}")


def check_planned_folder(folder: Path, case: Path | None = None) -> None:
    """Raise InputError where a planned case would take the place of a case that no plan wrote, or lie in one."""
    if (folder / HEADER).exists() and not (folder / PLAN).exists():
        same = case is not None and folder.resolve() == case.resolve()
        what = "is the case itself" if same else "holds another case"
        raise InputError(f"{folder}: {what}, which a plan does not overwrite; give --out a folder of its own")
    refuse_case(folder.resolve().parent)


def plan_files(given: Sequence[Path]) -> dict[str, Path]:
    """The files of plans by what to call each: after its file, or where that is plan.toml, after its folder.

    Args:
        given: files, or folders with a plan.toml, such as planned cases.

    Raises:
        InputError: two that are called the same.
    """
    files: dict[str, Path] = {}
    for path in given:
        file = path / PLAN if path.is_dir() else path
        name = file.resolve().parent.name if file.name == PLAN else file.stem
        if name in files:
            raise InputError(
                f"--plan {path}: a plan is called after its file, or its folder where that is {PLAN}, and "
                f"{files[name]} is called '{name}' too; give each plan once, under a name of its own"
            )
        files[name] = file
    return files
