"""Warnings on a plan, on options and their size, and on the end of a simulation: possible, but unusual."""

from __future__ import annotations

from collections.abc import Iterable

from warp_trunk.bone_motion.plan.planner import bending_films, flexibility_of
from warp_trunk.case import Case
from warp_trunk.case.case import Pose
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.engine.relaxation import Relaxation, RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.measures.number_text import sided
from warp_trunk.measures.quantities import BEFORE, PREDICTED, QUANTITIES, MeasureTable
from warp_trunk.spine import cobb_angles
from warp_trunk.spine.cobb import curves_after
from warp_trunk.spine.spine import spine_of
from warp_trunk.system import usable_memory

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


def endplate_warnings(before: Landmarks, after: Landmarks) -> list[str]:
    """A sentence where the endplates have errors, so that Cobb angles are read from a smooth line."""
    errors = {"before": spine_of(before).endplate_error, "after": spine_of(after).endplate_error}
    rough = " and ".join(f"{error:.1f} mm {state}" for state, error in errors.items() if error)
    if not rough:
        return []
    return [
        f"landmarks: the endplates are off a smooth line by {rough} surgery (each axis), because of their errors; "
        "Cobb angles are those of the line."
    ]


SHIFTED = 20.0
"""A trunk further beside the sacrum than this is out of balance [mm] (Scoliosis Research Society)."""
KYPHOSIS = (10.0, 40.0)
"""Normal kyphosis from T5 to T12 [degrees], as the Lenke classification grades it."""


def alignment_warnings(table: MeasureTable) -> list[str]:
    """A sentence for each state after surgery that a surgeon avoids, from the numbers before and predicted.

    These are a coronal shift, shoulders that reverse, an apex on the other side of its line, and a kyphosis out of
    the normal range. Shoulders and apices are only counted where both sides can be seen.
    """
    sentences = []

    def reverses(quantity: str, level: str = "") -> tuple[float, float] | None:
        was, will = (table.value(state, quantity, level) or 0.0 for state in (BEFORE, PREDICTED))
        seen = min(abs(was), abs(will)) >= QUANTITIES[quantity].detectable
        return (was, will) if seen and was * will < 0.0 else None

    shift = table.value(PREDICTED, "trunk_shift_mm") or 0.0
    if abs(shift) > SHIFTED:
        beside = sided(shift, " mm")
        sentences.append(f"Balance: the top of the spine ends {beside} of the sacrum, more than {SHIFTED:g} mm.")
    if both := reverses("shoulder_difference_mm"):
        was, will = (sided(value, " mm") for value in both)
        sentences.append(f"Shoulders: the higher one changes, from {was} to {will}.")
    for level in table.column(PREDICTED, "apical_translation_mm"):
        if both := reverses("apical_translation_mm", level):
            was, will = (sided(value, " mm") for value in both)
            sentences.append(f"Apex {level}: goes across the midline, from {was} to {will}.")
    kyphosis = table.value(PREDICTED, "kyphosis_deg", "T5-T12")
    if kyphosis is not None and not KYPHOSIS[0] <= kyphosis <= KYPHOSIS[1]:
        least, most = KYPHOSIS
        sentences.append(f"Kyphosis T5 to T12: ends at {kyphosis:.3g} degrees, {least:g} to {most:g} is normal.")
    return sentences


def flexibility_warnings(case: Case) -> list[str]:
    """A sentence for each curve that is corrected further than it bent out on films, by more than `GROWN`."""
    films = bending_films(case)
    curves = cobb_angles(case.landmarks_before) if films else ()
    bent_out = flexibility_of(curves, films)
    sentences = []
    for curve, after in zip(curves, curves_after(curves, case.planned_landmarks), strict=True):
        share = bent_out.get(curve.apex)
        if share is None or after is None or after >= (1.0 - share) * curve.angle - GROWN:
            continue
        sentences.append(
            f"Curve {curve.upper} to {curve.lower}: is corrected to {after:.0f} degrees, on the films of side "
            f"bending to {(1.0 - share) * curve.angle:.0f}."
        )
    return sentences


def option_warnings(tissues: Iterable[Tissue], gravity: float) -> list[str]:
    """A sentence for each constant that no soft tissue, or no place on the Earth, has."""
    warnings = [
        f"tissue: '{name}' is {value:g} {unit}, {least:g} to {most:g} is usual for soft tissue; look at its unit."
        for tissue in tissues
        for name, (least, most, unit) in USUAL_TISSUE.items()
        if not least <= (value := getattr(tissue, name)) <= most
    ]
    if gravity and not USUAL_GRAVITY[0] <= gravity <= USUAL_GRAVITY[1]:
        warnings.append(f"gravity: is {gravity:g} m/s^2, 9.81 is that of the Earth; look at its unit.")
    return list(dict.fromkeys(warnings))  # each once


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


LARGE = 1_000_000
"""From this number of tetrahedra on, memory and time are shown, and the stages of meshing."""
_MEMORY, _MEMORY_EACH = 0.5e9, 1000.0
"""Bytes of a run, and of each tetrahedron: 0.68, 1.07 and 1.75 GB with 0.22, 1.0 and 1.9 million, without TetGen's
process, which has as much and ends before the model is made."""
_SECONDS_EACH = 3.5e-4
"""Seconds for each tetrahedron on two cores: 70, 512 and 597 with the same numbers, beside other work."""


def check_memory(tets: int, *, go_on: bool = False) -> str | None:
    """A sentence on memory and time where the number of tetrahedra is large.

    Raises:
        InputError: it needs more memory than this machine has, and `go_on` is not set.
    """
    need, minutes, memory = _MEMORY + _MEMORY_EACH * tets, _SECONDS_EACH * tets / 60.0, usable_memory()
    cost = f"{tets} tetrahedra need about {need / 1e9:.1f} GB of memory and {minutes:.0f} min on two cores"
    if need > memory and not go_on:
        few = max(int((memory - _MEMORY) / _MEMORY_EACH), 0)
        raise InputError(f"tets: {cost}, this machine has {memory / 1e9:.1f} GB; ask for {few}, or give --yes")
    return cost if tets >= LARGE else None
