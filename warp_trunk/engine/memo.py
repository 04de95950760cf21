"""What is found of a trunk at rest whatever the plan, remembered so that it need not be found again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

Arrays = Mapping[str, np.ndarray]
"""Arrays by name."""


class Memo:
    """Arrays that depend on a model's mesh, constants and device alone; asked for by `arrays_of`.

    Who makes a model may give those of an earlier process, and store what had to be found.
    """

    def __init__(self, known: Arrays = MappingProxyType({})) -> None:
        """Begins with what is known: arrays by part and name, as in `asked`."""
        self._known = known
        self.asked: dict[str, np.ndarray] = {}
        """All arrays that were asked for, by part and name with a dot between."""
        self.is_new = False
        """Whether one of them had to be found."""

    def arrays(self, part: str, find: Callable[[], Arrays], fits: Callable[[Arrays], bool]) -> Arrays:
        """As `arrays_of`."""
        start = f"{part}."
        known = {n.removeprefix(start): a for n, a in {**self._known, **self.asked}.items() if n.startswith(start)}
        try:
            usable = bool(known) and fits(known)
        except (KeyError, ValueError, TypeError, IndexError):  # what does not fit can fail in any comparison
            usable = False
        arrays: Arrays = known if usable else find()
        self.is_new |= not usable
        self.asked |= {f"{start}{name}": values for name, values in arrays.items()}
        return arrays

    def forget(self) -> None:
        """Lets go of all arrays, when nothing more will be asked for."""
        self._known, self.asked = {}, {}


def arrays_of(memo: Memo | None, part: str, find: Callable[[], Arrays], fits: Callable[[Arrays], bool]) -> Arrays:
    """The arrays of a part of a trunk at rest: those that are remembered where they fit, else those found.

    Args:
        memo: what is remembered; nothing where there is none.
        part: name of the part.
        find: finds its arrays.
        fits: whether arrays that are remembered can be those of this trunk; it must not be taken on trust that
            indices lie in their range.
    """
    return find() if memo is None else memo.arrays(part, find, fits)
