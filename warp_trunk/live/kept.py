"""Plans that were kept: cases on disk, and views to compare with."""

from __future__ import annotations

import re
import shutil
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from warp_trunk.bone_motion.plan.planned_folder import write_planned_case
from warp_trunk.errors import InputError

if TYPE_CHECKING:
    from warp_trunk.case import Case

    from .session import View

MOST_NAME = 60
"""No plan has a longer name [characters]."""


class KeptPlans:
    """What was kept since the page was opened, by name; each is a case as `warp-trunk plan` writes it."""

    def __init__(self, folder: Path, case: Case) -> None:
        self.folder = folder
        self._case = case
        self._views: dict[str, View] = {}
        self._writing = threading.Lock()

    @property
    def names(self) -> tuple[str, ...]:
        """In the order in which they were kept."""
        return tuple(self._views)

    def get(self, name: str) -> View | None:
        """A plan as it was shown, at its best; None where there is none of that name."""
        return self._views.get(name)

    def free_name(self) -> str:
        """A name that none has yet."""
        number = 1
        while (self.folder / f"plan_{number}").exists():
            number += 1
        return f"plan_{number}"

    def keep(self, name: str, view: View) -> Path:
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
                write_planned_case(unfinished, self._case, view.surgery, name)
                unfinished.rename(folder)
            except OSError as error:
                raise InputError(f"{folder} could not be written ({error.strerror}); nothing was kept") from error
            self._views[name] = view
        return folder

    def improve(self, view: View) -> None:
        """Takes a better view of the same wish in place of the one that was kept."""
        for name, kept in self._views.items():
            if kept.number == view.number:
                self._views[name] = view
