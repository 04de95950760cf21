"""Whether vertebrae keep their shape from before to after surgery: a vertebra is rigid, and one patient's."""

from __future__ import annotations

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.rigid import fit_rigid, misfit

from .landmarks import VERTEBRA_POINTS, Landmarks
from .vertebra_order import exchanged, orders

REFUSED, WARNED = 6.0, 4.6
"""How far off the place that the other five give it a landmark may be, over the misfit (root mean square) of the
other vertebrae. 99.9 and 99 % of vertebrae are nearer, whose landmarks have the errors that the papers state
before and after surgery (2.1 +- 1.5 mm; docs/from_films.md)."""
REFUSED_RANGE, WARNED_RANGE = (8.0, 16.5), (4.0, 12.5)
"""Within these it is held [mm]: better landmarks than any reconstruction's are not asked to be perfect, nor may
worse than the papers' excuse each other."""
SIZE_REFUSED, SIZE_WARNED = 0.05, 0.038
"""How much larger or smaller all vertebrae together may be after; 0.038 is passed by errors of landmarks in one
case of a thousand."""
MISFIT = 4.0
"""Misfit of half of the vertebrae [mm] beyond which they are another patient's; errors of landmarks come to 3.6
in one case of a thousand."""
_ENOUGH = 8
"""So many vertebrae tell a patient from another."""


def check_shapes(before: Landmarks, after: Landmarks, where: str) -> list[str]:
    """Check that the six landmarks of each vertebra move as a rigid body.

    Args:
        before: six for each vertebra [mm].
        after: those after, by the same names.
        where: the file of those after, for the error.

    Returns:
        A sentence for what errors of landmarks seldom come to.

    Raises:
        InputError: what they do not come to: a vertebra of another shape, naming the landmark, by how much it is
            off, and whether an exchange of names explains it; or another patient's vertebrae.
    """
    levels = before.vertebrae()
    here, there = (
        np.array([[marks.point(f"{level}_{name}") for name in VERTEBRA_POINTS] for level in levels])
        for marks in (before, after)
    )
    misfits = np.array([misfit(a, b) for a, b in zip(here, there, strict=True)])
    warnings = _check_patient(here, there, misfits, where)
    for i, level in enumerate(levels):
        usual = float(np.median(np.delete(misfits, i)))
        refused = float(np.clip(REFUSED * usual, *REFUSED_RANGE))
        warned = float(np.clip(WARNED * usual, *WARNED_RANGE))
        if 6.0 * misfits[i] <= warned:  # a landmark is off by 3 to 4 times the misfit it causes
            continue
        point, off = _worst(here[i], there[i])
        if off <= warned:
            continue
        text = (
            f"{where}: '{level}_{VERTEBRA_POINTS[point]}' is {off:.1f} mm from where the other five landmarks of "
            f"{level} put it, though a vertebra is rigid"
        )
        if off <= refused:
            warnings.append(f"{text}; errors of landmarks seldom come to {warned:.1f} mm, so look at it again.")
            continue
        order = next((o for o in orders() if misfit(here[i], there[i][list(o)]) < 0.5 * warned), None)
        cure = "mark it again, before and after" if order is None else exchanged(level, order)
        raise InputError(f"{text}, and errors of landmarks come to {refused:.1f} mm at most; {cure}")
    return warnings


def _check_patient(here: np.ndarray, there: np.ndarray, misfits: np.ndarray, where: str) -> list[str]:
    """Check that all vertebrae together (levels, 6, 3) are of one size and shape before and after."""
    if len(here) < _ENOUGH:
        return []
    usual = float(np.median(misfits))
    sizes = [np.linalg.norm(six - six.mean(axis=1, keepdims=True), axis=(1, 2)).sum() for six in (here, there)]
    growth = float(sizes[1] / sizes[0] - 1.0)
    if abs(growth) > SIZE_REFUSED or usual > MISFIT:
        raise InputError(
            f"{where}: the vertebrae are another patient's: against those before they are {100 * growth:+z.1f} % "
            f"larger ({100 * SIZE_REFUSED:g} is the most) and {usual:.1f} mm off in shape (median of root mean "
            f"squares, {MISFIT:g} is the most); give landmarks of one patient, in one unit"
        )
    if abs(growth) > SIZE_WARNED:
        return [
            f"{where}: the vertebrae are {100 * growth:+z.1f} % larger than before; errors of landmarks seldom "
            f"come to {100 * SIZE_WARNED:g} %, so look whether both files are of one patient."
        ]
    return []


def _worst(before: np.ndarray, after: np.ndarray) -> tuple[int, float]:
    """The landmark without which the others fit best, and how far it is from where they put it [mm]."""
    found = []
    for k in range(len(before)):
        others = np.arange(len(before)) != k
        moved = fit_rigid(before[others], after[others]).apply(before)
        off = np.linalg.norm(moved - after, axis=1)
        found.append((float(np.sum(off[others] ** 2)), k, float(off[k])))
    _, point, off = min(found)
    return point, off
