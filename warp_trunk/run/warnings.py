"""Warnings on a plan, on options, and on the end of a simulation: possible, but unusual."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.measures import cobb_angles

if TYPE_CHECKING:
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.case.study import Pose
    from warp_trunk.engine.relaxation import Relaxation
    from warp_trunk.engine.tissue import Tissue

USUAL_TISSUE = {"youngs_modulus": (0.5, 500.0, "kPa"), "density": (800.0, 1200.0, "kg/m3")}
"""Constants of soft tissue at small strain, least and most: fat 2.5 kPa and 950 kg/m3, skin 130 kPa and 1090,
single reports of both some times softer or stiffer (`warp_trunk.case.layers`)."""
USUAL_GRAVITY = (9.7, 9.9)
"""Gravity on the Earth [m/s^2]; 0 is off."""
GROWN = 5.0
"""A curve larger by more than this is worse, and not measured otherwise [degrees]."""


def curve_warnings(before: Landmarks, after: Landmarks, pose: Pose = "surgery") -> list[str]:
    """A sentence where the largest curve of the spine after surgery is larger than the largest before.

    The curve of a patient who bends may well be larger."""
    if pose == "bending":
        return []
    was, will = (max((curve.angle for curve in cobb_angles(marks)), default=0.0) for marks in (before, after))
    if will <= was + GROWN:
        return []
    return [
        f"The largest curve of the spine grows, from {was:.0f} to {will:.0f} degrees; "
        "look whether landmarks_before and landmarks_after are exchanged."
    ]


def option_warnings(tissues: Iterable[Tissue], gravity: float) -> list[str]:
    """A sentence for each constant that no soft tissue, or no place on the Earth, has."""
    found: dict[str, None] = {}  # each once, in order
    for tissue in tissues:
        for name, (least, most, unit) in USUAL_TISSUE.items():
            value = getattr(tissue, name)
            if not least <= value <= most:
                found[
                    f"tissue: '{name}' is {value:g} {unit}, {least:g} to {most:g} is usual for soft tissue; "
                    "look at its unit."
                ] = None
    if gravity and not USUAL_GRAVITY[0] <= gravity <= USUAL_GRAVITY[1]:
        found[f"gravity: is {gravity:g} m/s^2, 9.81 is that of the Earth; look at its unit."] = None
    return list(found)


def _unfinished(last: Relaxation) -> list[str]:
    """A sentence on a relaxation that took all its steps, or that followed the gradient to its end."""
    if last.status is RelaxStatus.STOPPED:
        where = f"the equilibrium is about {last.estimated_error:.2g} mm away"
        return [f"The energy no longer falls along the gradient, and {where}; use --method newton to reach it."]
    if last.status is RelaxStatus.STEP_LIMIT:
        return ["The relaxation took the most steps allowed; give more --max-steps, or use --method newton."]
    return []


def ending_warnings(last: Relaxation, held: list[str], folded: list[str]) -> list[str]:
    """Advice on a result that is incomplete.

    Args:
        last: how the last relaxation ended.
        held: where bones collide (`colliding_bones`), in words.
        folded: where the bones' path folds the tissue (`folded_tissue`), in words.
    """
    stalled, unfinished = last.status is RelaxStatus.STALLED, _unfinished(last)
    if not (last.inverted_tets or stalled):
        return unfinished
    count = last.inverted_tets
    what = (
        f"{count} {'tetrahedron is' if count == 1 else 'tetrahedra are'} inside out at the end"
        if count
        else "The tissue found no equilibrium"
    )
    if held or folded:
        return [*unfinished, f"{what}; {(held or folded)[0]}. Look at the landmarks there."]
    if stalled:
        return [f"{what}, in float64 neither; use a larger tolerance or more increments."]
    return [*unfinished, f"{what}; do not trust the skin near them, and use more increments or another mesh."]
