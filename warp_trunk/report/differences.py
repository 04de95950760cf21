"""In which numbers plans differ, in words, and in which they cannot be told apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.measures.comparison import DETECTABLE

from .curves import curve_changes
from .sentences import height_gained
from .tables import Row, plain, sided

if TYPE_CHECKING:
    from .style import Pose

ANGLE = 5.0
"""Angles of the spine that differ by less are alike [degrees]: what two readers of a film differ by."""
LENGTH = 5.0
"""Lengths that differ by less are alike [mm]."""


@dataclass(frozen=True)
class Compared:
    """One number for every plan."""

    name: str
    """What it is."""
    short: str
    """The same in a sentence."""
    unit: str
    """Its unit, with a space where there is one."""
    before: float | None
    """Before surgery; None where it is not known, or is nothing before surgery."""
    plans: tuple[float | None, ...]
    """Of every plan."""
    alike: float
    """Plans that differ by less are alike."""
    sided: bool = True
    """Whether it is positive to the patient's right."""

    def row(self) -> Row:
        """Its row of a table."""
        text = sided if self.sided else plain
        return [f"{self.name} [{self.unit}]", text(self.before), *(text(value) for value in self.plans)]

    @property
    def differ(self) -> bool | None:
        """Whether the plans can be told apart by it; None where one of them is not known."""
        known = [value for value in self.plans if value is not None]
        return None if len(known) < len(self.plans) else max(known) - min(known) >= self.alike


def compared(before: Pose, plans: Sequence[Pose]) -> dict[str, list[Compared]]:
    """What plans are chosen by, under headings: the spine, then the back."""
    return {
        "The spine, as planned": list(_spine(before, plans)),
        "The back, as predicted": list(_back(before, plans)),
    }


def differences(before: Pose, plans: Sequence[Pose]) -> list[str]:
    """What differs between plans, a sentence each, and last what does not."""
    numbers = [number for group in compared(before, plans).values() for number in group]
    told = [f"{number.name}: {_listed(number, plans)}." for number in numbers if number.differ]
    told += _skins(plans)
    alike = [number.short for number in numbers if number.differ is False]
    if alike:
        limits = f"within {ANGLE:g}° of the spine, {DETECTABLE:g}° of the back and {LENGTH:g} mm"
        told.append(f"Too alike to choose by, {limits}: {', '.join(alike)}.")
    return told


def _spine(before: Pose, plans: Sequence[Pose]) -> Iterator[Compared]:
    followed = [curve_changes(before, plan) for plan in plans]
    for number, curve in enumerate(followed[0]):
        name = f"Cobb angle {curve.ends}, convex to the {curve.before.convex}"
        angles = tuple(changes[number].angle_after for changes in followed)
        yield Compared(name, f"Cobb {curve.ends}", "°", curve.before.angle, angles, ANGLE, sided=False)
        apex = curve.apex_before
        turned = tuple(changes[number].apex_after.rotation for changes in followed)
        yield Compared(
            f"Rotation of its apex {apex.level}", f"rotation of {apex.level}", "°", apex.rotation, turned, ANGLE
        )
    every = [before.measures, *(plan.measures for plan in plans)]
    for name, short, (was, *will) in (
        ("Kyphosis T5 to T12", "kyphosis", [m.kyphosis["T5-T12"] for m in every]),
        ("Lordosis L1 to L5", "lordosis", [m.lordosis["L1-L5"] for m in every]),
    ):
        yield Compared(name, short, "°", was, tuple(will), ANGLE, sided=False)
    was, *will = [m.trunk_shift and m.trunk_shift.lateral for m in every]
    yield Compared("Top of the spine beside the sacrum", "balance to the side", "mm", was, tuple(will), LENGTH)
    gained = tuple(height_gained(before.measures, m) for m in every[1:])
    yield Compared("Height gained", "height gained", "mm", None, gained, LENGTH, sided=False)


def _back(before: Pose, plans: Sequence[Pose]) -> Iterator[Compared]:
    every = [before.measures, *(plan.measures for plan in plans)]
    bsr = "Rotation of the back (BSR), largest from"
    for name, short, unit, (was, *will), alike in (
        (f"{bsr} T1 to T12", "rotation of the upper back", "°", [m.max_thoracic_bsr for m in every], DETECTABLE),
        (f"{bsr} L1 to L5", "rotation of the lower back", "°", [m.max_lumbar_bsr for m in every], DETECTABLE),
        ("Hump, largest", "hump", "mm", [m.max_hump for m in every], LENGTH),
        (
            "Higher shoulder, by",
            "shoulders",
            "mm",
            [m.shoulders and m.shoulders.difference for m in every],
            LENGTH,
        ),
    ):
        yield Compared(name, short, unit, was, tuple(will), alike)


def _listed(number: Compared, plans: Sequence[Pose]) -> str:
    text = sided if number.sided else plain
    unit = "°" if number.unit == "°" else f" {number.unit}"
    cells = []
    for plan, value in zip(plans, number.plans, strict=True):
        size, *side = text(value, 0).split(" ")
        cells.append(f"{' '.join([f'{size}{unit}', *side])} with {plan.look.title}")
    return f"{', '.join(cells[:-1])} and {cells[-1]}"


def _skins(plans: Sequence[Pose]) -> list[str]:
    """How far apart the predicted skins are, each plan against the first."""
    first = plans[0]
    told = []
    for plan in plans[1:]:
        apart = np.linalg.norm(plan.skin.vertices - first.skin.vertices, axis=1)
        told.append(
            f"The predicted skins of {first.look.title} and {plan.look.title} are up to {apart.max():.0f} mm "
            f"apart, {apart.mean():.0f} mm on average."
        )
    return told
