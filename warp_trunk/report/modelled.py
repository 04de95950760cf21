"""What a simulation took into account and what it did not, in words, from its summary."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

ENERGIES = {
    "itmsm": "springs on the edges, faces and volumes of tetrahedra (the energy of [2])",
    "neo-hookean": "a neo-Hookean continuum",
}
BONES = {"spline": "carried by a smooth interpolation (thin-plate spline) of the landmarks of the plan"}


def modelled(summary: Mapping[str, Any]) -> list[str]:
    """What was modelled, one phrase for each thing."""
    options = summary["parameters"]
    energy, bones = options.get("energy", "itmsm"), options.get("bones", "spline")
    gravity = options.get("gravity") or 0.0
    return [
        f"Soft tissue: one elastic material in {summary['tets']:,} tetrahedra, as {ENERGIES.get(energy, energy)}; "
        f"terms: {', '.join(summary['terms'])}.",
        f"Bones: {BONES.get(bones, bones)}, in {len(summary['increments'])} equal parts.",
        f"Gravity: {gravity:g} m/s²." if gravity else "Gravity: only as far as the scan before surgery holds it.",
        f"Inverted tetrahedra at the end: {summary['inverted_tets']}.",
    ]


def not_modelled(summary: Mapping[str, Any]) -> list[str]:
    """What was not, one phrase for each thing."""
    missing = ["skin, fat and muscle as different materials", "the pull of muscles, breathing and posture"]
    if summary["parameters"].get("bones", "spline") == "spline":
        missing.append("joints: ribs and shoulder blades follow the spine smoothly")
    return [*missing, "growth, and changes of weight after surgery", "scars and swelling"]
