"""Draws of all errors at once: what they do to the skin, and whether numbers change in proportion to them.

The tissue follows a draw by one linear solve; the measures of a drawn skin are compared with what the
sensitivities say of the same draw.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.engine.linearization import Linearization
from warp_trunk.geometry.normals import vertex_normals
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import TrunkMeasures, measure
from warp_trunk.results import predicted_skin

from .options import RunOptions
from .paths import find_path
from .prepare import Prepared
from .sensitivities import Sensitivity, constant_names
from .sources import Source

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.simulation import Increment

ACCURACY = 1e-2
"""Part of what a draw moves by which its skin may be wrong: far below what so few draws tell."""
PROPORTION = 0.3
"""A number changes in proportion where draws stray from it by less than this part of their size."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """What draws of all errors show."""

    ratio: np.ndarray
    """Deviation of each number over what its sensitivities say of the same draws, shape (numbers,)."""
    linear: np.ndarray
    """Whether each changes in proportion, shape (numbers,)."""
    skin: np.ndarray
    """Standard deviation of each vertex along its normal [mm], shape (vertices,)."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What every draw needs."""

    case: Case
    prepared: Prepared
    options: RunOptions
    linear: Linearization
    increment: Increment
    found: tuple[Sensitivity, ...]

    def draw(
        self, sources: Sequence[Source], effects: np.ndarray, draws: int, random: np.random.Generator
    ) -> Drawn:
        """Draws all errors at once, and lets the tissue follow."""
        case, trunk = self.case, self.prepared.trunk
        sd, shape = case.uncertainty.landmark_sd, case.landmarks_before.points.shape
        sizes = random.standard_normal((draws, len(sources)))
        before, after = sd * random.standard_normal((2, draws, *shape))
        straight = [
            np.einsum("dli,li->d", before, one.landmarks_before)
            + np.einsum("dli,li->d", after, one.landmarks_after)
            for one in self.found
        ]
        straight = np.array(straight).T + sizes @ effects.reshape(len(sources), len(self.found))
        for source, size in zip(sources, sizes.T, strict=True):
            if source.landmarks_after is not None:
                after += size[:, None, None] * source.landmarks_after
        moved = [self.moved(*pair) for pair in zip(before, after, strict=True)]
        skin = predicted_skin(case, trunk, self.increment.displacement)
        followed = self.followed(moved, sources, sizes)[:, trunk.skin_nodes]
        measured = [
            self.numbers(measure(Surface(skin.vertices + by, skin.faces), drawn.planned_landmarks))
            for by, drawn in zip(followed, moved, strict=True)
        ]
        along = np.einsum("dvi,vi->dv", followed, vertex_normals(skin))
        seen = np.array(measured) - [one.value for one in self.found]
        return Drawn(*_proportion(straight, seen), skin=np.sqrt(np.square(along).mean(axis=0)))

    def followed(self, moved: Sequence[Case], sources: Sequence[Source], sizes: np.ndarray) -> np.ndarray:
        """How all nodes follow the moved landmarks and the sources, of these sizes, (draws, nodes, 3) [mm]."""
        trunk = self.prepared.trunk
        before = self.prepared.bone_path.at(1.0)
        bones = np.array([find_path(case, trunk, self.options).at(1.0) - before for case in moved])
        pulls = np.zeros_like(bones)
        names = constant_names(self.prepared)
        for source, size in zip(sources, sizes.T, strict=True):
            by = size[:, None, None]
            if source.bones is not None:
                bones += by * source.bones
            for name, change in source.constants.items():
                pulls += by * (change * self.linear.pull(names[name]))
        return self.linear.follow(bones, pulls, ACCURACY)

    def moved(self, before: np.ndarray, after: np.ndarray) -> Case:
        """The case with its landmarks moved."""
        names, case = self.case.landmarks_before.names, self.case
        return replace(
            case,
            landmarks_before=Landmarks(names, case.landmarks_before.points + before),
            landmarks_after=Landmarks(names, case.planned_landmarks.points + after),
        )

    def numbers(self, measured: TrunkMeasures) -> list[float]:
        """The numbers of another skin, at the same levels; NaN where one is missing."""
        values: list[float | None] = []
        for one in self.found:
            kind, _, level = one.name.partition(" ")
            if kind == "bsr":
                values.append(measured.bsr.get(level))
            elif kind == "hump":
                values.append(measured.hump_height.get(level))
            else:
                values.append(None if measured.shoulders is None else measured.shoulders.difference)
        return [math.nan if value is None else value for value in values]


def _proportion(said: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The ratio of deviations and whether proportion holds, of changes said and seen, (draws, numbers) each.

    Where a draw has no such number, or nothing varies, the ratio is 1; the former is not in proportion.
    """
    known = np.isfinite(seen)
    whole = known.all(axis=0)
    seen = np.where(known, seen, said)
    spread, wanted = seen.std(axis=0), said.std(axis=0)
    ratio = np.divide(spread, wanted, out=np.ones_like(wanted), where=wanted > 0.0)
    stray = np.sqrt(np.square(seen - said).mean(axis=0))
    return ratio, whole & (stray <= PROPORTION * np.maximum(wanted, 1e-9))
