"""Plans that were kept, now or before: cases on disk, and views to compare with."""

import re
import shutil
import threading
from pathlib import Path

import numpy as np

from warp_trunk.bone_motion.plan import Plan, read_plan
from warp_trunk.bone_motion.plan.plan_file import write_planned_case
from warp_trunk.case import Case
from warp_trunk.case.folders import HEADER
from warp_trunk.case.landmarks import read_landmarks
from warp_trunk.errors import InputError
from warp_trunk.io.file_names import check_file_names
from warp_trunk.io.result_files import PLAN

from .session import PlanView
from .sliders import MotionPlan

MOST_NAME = 60
"""No plan has a longer name [characters]."""


class SavedPlans:
    """Plans of this patient in a folder, by name; each is a case as `warp-trunk plan` writes it."""

    def __init__(self, folder: Path, case: Case) -> None:
        """Finds those that were kept before; other content of the folder is ignored."""
        self.folder, self._case, self._writing = folder, case, threading.Lock()
        self.earlier = _plans_in(folder, case)
        """The plans that were kept before the page was opened."""
        self.views: dict[str, PlanView] = {}
        """The plans that were shown, each at its best."""

    @property
    def names(self) -> tuple[str, ...]:
        """Those of before, then in the order in which they were kept."""
        return tuple({**self.earlier, **self.views})

    def free_name(self) -> str:
        """A name that no plan has yet."""
        number = 1
        while (self.folder / f"plan_{number}").exists():
            number += 1
        return f"plan_{number}"

    def keep(self, name: str, view: PlanView) -> Path:
        """Writes the plan of a view as a case; its folder is whole or not there.

        Returns:
            The case folder.

        Raises:
            InputError: a name that cannot be a folder's or is taken, or a disk that cannot be written to.
        """
        if not re.fullmatch(r"\w[\w.-]*", name) or len(name) > MOST_NAME:
            raise InputError(
                f"'{name[:MOST_NAME]}' cannot name a plan: use up to {MOST_NAME} letters, digits, '-', '_' and '.'"
            )
        check_file_names([name], "plan")
        folder = self.folder / name
        with self._writing:
            if folder.exists():
                raise InputError(f"a plan '{name}' exists already; give this one another name")
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
            self.views[name] = view
        return folder

    def improve(self, view: PlanView) -> None:
        """Takes a better view of the same state in place of the one that was kept."""
        self.views |= {name: view for name, saved in self.views.items() if saved.number == view.number}


def _plans_in(folder: Path, case: Case) -> dict[str, Plan]:
    """The plans of a patient that lie in a folder, by name: planned cases with her landmarks before surgery."""
    plans, hers = {}, case.landmarks_before
    for path in sorted(folder.glob(f"[!.]*/{PLAN}")):
        try:
            before = read_landmarks(path.parent / "landmarks_before.csv")
            same = before.names == hers.names and np.array_equal(before.points, hers.points)
            if same and (path.parent / HEADER).exists():
                plans[path.parent.name] = read_plan(path)
        except InputError:
            continue
    return plans
