"""Random choices that are the same on every machine: what a test draws follows from its seed and nothing else.

A library that searches for counterexamples draws what it likes: its examples change with its version and with the
modules that happen to be loaded. Here each number comes from `random.Random(seed).random()`, whose sequence Python
promises to keep.
"""

from __future__ import annotations

import os
import random
import secrets
from collections.abc import Iterator, Sequence
from typing import TypeVar

T = TypeVar("T")


class Draws:
    """Choices that follow from a seed."""

    def __init__(self, seed: int) -> None:
        self._next = random.Random(seed).random

    def chance(self, share: float) -> bool:
        """True in that share of all draws."""
        return self._next() < share

    def whole(self, least: int, most: int) -> int:
        """A whole number, both ends included."""
        return least + int(self._next() * (most - least + 1))

    def number(self, least: float, most: float) -> float:
        """Anywhere between the ends, but often at an end, at zero or close to it: that is where code breaks."""
        special = [x for x in (least, most, 0.0, 1e-3 * most) if least <= x <= most]
        if self.chance(0.2):
            return self.one_of(special)
        return least + self._next() * (most - least)

    def one_of(self, choices: Sequence[T]) -> T:
        """One of them, each as likely."""
        return choices[self.whole(0, len(choices) - 1)]

    def data(self, most: int) -> bytes:
        """Noise of any length up to `most`."""
        return bytes(self.whole(0, 255) for _ in range(self.whole(0, most)))


def fresh_seeds() -> Iterator[int]:
    """New random seeds, for `pytest -m search`: as many as WARP_TRUNK_SEARCH says, else 100."""
    for _ in range(int(os.environ.get("WARP_TRUNK_SEARCH", "100"))):
        yield secrets.randbits(32)
