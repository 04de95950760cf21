"""The result of a search for a better plan, for a terminal."""

from __future__ import annotations

from warp_trunk.bone_motion.plan.bounds import shares_of
from warp_trunk.results.bands import WIDTH

from .best_plan import BestPlan

_AIMS = {"hump": ("largest hump", "mm"), "bsr": ("largest back surface rotation", "degrees")}


def best_plan_text(found: BestPlan) -> str:
    """The shares that changed, what is gained against the plan as given, and how sure that is."""
    search, given, best = found.search, found.given, found.best
    name, unit = _AIMS[search.aim]
    lines = [f"{f'plan within the bounds, {len(found.trials)} relaxations':<42}{'given':>8}{'best':>8}   bounds"]
    for bound, share in zip(search.bounds, shares_of(found.plan, search.bounds), strict=True):
        was = shares_of(search.plan, (bound,))[0]
        at = " (at its end)" if share in (bound.low, bound.high) else ""
        ends = f"{bound.low:g} to {bound.high:g}{at}"
        lines.append(f"{f'{bound.target} of {bound.apex}':<42}{was:>8.2f}{share:>8.2f}   {ends}")
    lines.append(f"{f'{name} [{unit}]':<42}{given.value:>8.1f}{best.value:>8.1f}   at {given.level}, {best.level}")
    return "\n".join([*lines, _gained(found, unit)])


def _gained(found: BestPlan, unit: str) -> str:
    if found.best is found.given:
        return "No plan within the bounds was found that is better than the plan as given."
    band = WIDTH * found.gain_sd
    said = f"Gained: {found.gain:.1f} ± {band:.1f} {unit} (in 19 of 20 such operations)"
    if found.gain < band:
        return f"{said}. The gain is smaller than its band: choose between the two plans by other reasons."
    return f"{said}."
