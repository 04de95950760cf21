"""Plans that were kept, now or before: cases on disk, and views to compare with."""

from __future__ import annotations

import re
import shutil
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.bone_motion.plan import read_plan
from warp_trunk.bone_motion.plan.plan_file import PLAN, write_planned_case
from warp_trunk.case.case_writer import HEADER
from warp_trunk.case.landmarks import read_landmarks
from warp_trunk.errors import InputError

from .motion_wish import MotionPlan

if TYPE_CHECKING:
    from warp_trunk.bone_motion.plan import Plan
    from warp_trunk.case import Case

    from .session import PlanView

MOST_NAME = 60
"""No plan has a longer name [characters]."""


class KeptPlans:
    """Plans of this patient in a folder, by name; each is a case as `warp-trunk plan` writes it."""

    def __init__(self, folder: Path, case: Case) -> None:
        """Finds those that were kept before; what of the folder is no plan of this patient is passed over."""
        self.folder = folder
        self._case = case
        self._views: dict[str, PlanView] = {}
        self._plans = _plans_in(folder, case)
        self._writing = threading.Lock()

    @property
    def names(self) -> tuple[str, ...]:
        """Those of before, then in the order in which they were kept."""
        return tuple({**self._plans, **self._views})

    @property
    def new_names(self) -> tuple[str, ...]:
        """Those that were kept since the page was opened."""
        return tuple(name for name in self._views if name not in self._plans)

    def get(self, name: str) -> PlanView | None:
        """A plan as it was shown, at its best; None where it was not shown yet, or there is none of that name."""
        return self._views.get(name)

    def plan(self, name: str) -> Plan | None:
        """A plan that was kept before the page was opened."""
        return self._plans.get(name)

    def found(self, name: str, view: PlanView) -> None:
        """Takes a view of a plan that was kept before."""
        self._views[name] = view

    def free_name(self) -> str:
        """A name that none has yet."""
        number = 1
        while (self.folder / f"plan_{number}").exists():
            number += 1
        return f"plan_{number}"

    def keep(self, name: str, view: PlanView) -> Path:
        """Writes the plan of a view as a case, one after another; its folder is whole or not there.

        Returns:
            The case folder.

        Raises:
            InputError: a name that cannot be a folder's or is taken, or a disk that cannot be written to.
        """
        if not re.fullmatch(r"\w[\w.-]*", name) or len(name) > MOST_NAME:
            raise InputError(
                f"'{name[:MOST_NAME]}' cannot name a plan: use up to {MOST_NAME} letters, digits, '-', '_' and '.'"
            )
        folder = self.folder / name
        with self._writing:
            if folder.exists():
                raise InputError(f"a plan '{name}' is there already; give this one another name")
            unfinished = self.folder / f".{name}.partial"  # a name that no plan has
            try:
                shutil.rmtree(unfinished, ignore_errors=True)  # of a page that was killed
                if isinstance(view.surgery, MotionPlan):
                    view.surgery.write(unfinished, self._case, name)
                else:
                    write_planned_case(unfinished, self._case, view.surgery, name)
                unfinished.rename(folder)
            except OSError as error:
                raise InputError(f"{folder} could not be written ({error.strerror}); nothing was kept") from error
            self._views[name] = view
        return folder

    def improve(self, view: PlanView) -> None:
        """Takes a better view of the same wish in place of the one that was kept."""
        for name, kept in self._views.items():
            if kept.number == view.number:
                self._views[name] = view


def _plans_in(folder: Path, case: Case) -> dict[str, Plan]:
    """The plans of a patient that lie in a folder, by name: planned cases with her landmarks before surgery."""
    found = {}
    for path in sorted(folder.glob(f"[!.]*/{PLAN}")):
        try:
            before = read_landmarks(path.parent / "landmarks_before.csv")
            hers = before.names == case.landmarks_before.names
            if (
                hers
                and np.array_equal(before.points, case.landmarks_before.points)
                and (path.parent / HEADER).exists()
            ):
                found[path.parent.name] = read_plan(path)
        except InputError:
            continue
    return found
