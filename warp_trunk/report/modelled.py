"""Modelled effects and options of a simulation, in words, from its summary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from warp_trunk.engine.tissue import Tissue
from warp_trunk.results.summary_text import spring_lines

if TYPE_CHECKING:
    from warp_trunk.results import Summary

BONES = {
    "spline": "carried by a smooth interpolation (thin-plate spline) of the landmarks of the plan",
    "given": "each moved as a rigid body as the motions say; those that are not named stand still",
    "follow": "each moved as a rigid body; ribs and sternum follow the vertebrae by stated shares",
}
"""How bones are carried, by the option of the simulation."""


def modelled(summary: Summary) -> list[str]:
    """The modelled effects, a phrase for each."""
    options, terms = summary.parameters, summary.terms
    bones = options.get("bones", "spline") if summary.has_spine else "given"
    energy = "springs on edges, faces and volumes [2]" if "distance" in terms else "a neo-Hookean continuum"
    return [
        f"Soft tissue: {_tissues(summary.tissues)} in {summary.tets:,} tetrahedra, as {energy} "
        f"(terms: {', '.join(terms)}).",
        f"Bones: {BONES.get(bones, bones)}, in {len(summary.increments)} equal parts.",
        f"Skin: {_skin(terms)}.",
        f"Gravity: {_gravity(options)}.",
        *([] if summary.springs is None else spring_lines(summary.springs)),
        f"Inverted tetrahedra at the end: {summary.inverted_tets}; nodes that came off the bones for it: "
        f"{summary.released_nodes}.",
    ]


def not_modelled(summary: Summary) -> list[str]:
    """The effects that were not modelled, a phrase for each."""
    missing = [
        "the pull of muscles, breathing and posture",
        "growth, and changes of weight after surgery",
        "scars",
    ]
    if len(summary.tissues) == 1:
        missing.insert(0, "skin, fat and muscle as different materials")
    if summary.parameters.get("bones", "spline") == "spline":
        missing.append("joints: ribs and shoulder blades follow the spine smoothly")
    return missing


def _tissues(tissues: Sequence[Tissue]) -> str:
    if len(tissues) == 1:
        return "one elastic material"
    moduli = ", ".join(f"{tissue.youngs_modulus:g}" for tissue in tissues)
    return f"{len(tissues)} elastic materials (Young's moduli from the skin inwards {moduli} kPa)"


def _skin(terms: Sequence[str]) -> str:
    return "a thin plate that resists bending" if "bending" in terms else "only the surface of the tissue"


def _gravity(options: Mapping[str, Any]) -> str:
    if not options.get("gravity"):
        return "only as far as the scan before surgery already holds its pull"
    rest = {
        "sag-free": "; the scan before surgery is in balance with it",
        "scan": "; the scan before surgery was taken as free of it, so that the trunk sags further",
    }
    return f"{options['gravity']:g} m/s²{rest.get(options.get('rest', ''), '')}"


UNITS = {
    "bone_margin": "mm",
    "bone_voxel": "mm",
    "bone_edge_length": "mm",
    "bone_tolerance": "mm",
    "tolerance": "mm",
    "gravity": "m/s^2",
    "skin_rigidity": "N mm",
    "density": "kg/m^3",
    "youngs_modulus": "kPa",
}
"""Units of options by name, as their documentation has them; all others have none."""
_SHOWN = {"m/s^2": "m/s²", "kg/m^3": "kg/m³", "degrees": "°"}


def option_rows(parameters: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Each option in words, as on the command line but for its dashes, with its value and unit."""
    return [(name.replace("_", " "), value_text(value, UNITS.get(name, ""))) for name, value in parameters.items()]


def value_text(value: object, unit: str = "") -> str:
    """A value as text, with its unit; a dash for none."""
    if value is None or value == []:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(str, value))
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{text} {_SHOWN.get(unit, unit)}".rstrip()
