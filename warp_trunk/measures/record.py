"""Measures in plain JSON types, and the same as rows of a table; a unit ends each name."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from .rows import value_at

if TYPE_CHECKING:
    from .comparison import SkinComparison
    from .measures import TrunkMeasures
    from .skin_distance import DistanceStatistics

COLUMNS = ("where", "measure", "value")
"""Header of the rows."""


_WHOLE = {
    "max_thoracic_bsr_deg": "max_thoracic_bsr",
    "max_lumbar_bsr_deg": "max_lumbar_bsr",
    "max_hump_mm": "max_hump",
    "max_hump_level": "hump_level",
    "trunk_shift_mm": "trunk_shift.lateral",
    "trunk_shift_forward_mm": "trunk_shift.forward",
    "trunk_shift_of": "trunk_shift.upper",
    "trunk_shift_over": "sacral_line.landmark",
    "shoulder_difference_mm": "shoulders.difference",
    "kyphosis_deg": "kyphosis",
    "lordosis_deg": "lordosis",
    "spine_height_mm": "spine_height.height",
    "spine_height_over": "spine_height.lower",
    "skin_change_max_mm": "skin_change_max",
    "skin_change_mean_mm": "skin_change_mean",
}
"""Where `value_at` finds each measure."""
_LEVEL = {
    "bsr_deg": "bsr.{}",
    "axial_rotation_deg": "axial_rotation.{}",
    "hump_mm": "hump_height.{}",
    "left_flank_mm": "flanks.{}.left",
    "right_flank_mm": "flanks.{}.right",
    "flank_asymmetry_percent": "flanks.{}.index",
}


def measures_record(measures: TrunkMeasures) -> dict[str, Any]:
    """Measures of one skin; None is missing, and `missing` says why."""
    curves = [
        {
            "cobb_deg": curve.angle,
            **{name: getattr(curve, name) for name in ("upper", "lower", "apex", "convex")},
            "apical_rotation_deg": apex.rotation,
            "apical_translation_mm": apex.translation,
            "apical_translation_from": apex.line,
            "neutral_above": apex.neutral_above,
            "neutral_below": apex.neutral_below,
        }
        for curve, apex in zip(measures.cobb, measures.apices, strict=True)
    ]
    levels = {
        level: {name: value_at(measures, path.format(level)) for name, path in _LEVEL.items()}
        for level in measures.tangents
    }
    whole = {name: value_at(measures, path) for name, path in _WHOLE.items()}
    return whole | {"curves": curves, "levels": levels, "missing": dict(measures.missing)}


def comparison_record(comparison: SkinComparison) -> dict[str, Any]:
    """A prediction against the actual skin, without its values by vertex."""
    return {
        "bsr_error": {
            name: None
            if error is None
            else {
                "levels": list(error.levels),
                **{f"{part}_deg": getattr(error, part) for part in ("mean", "sd", "of_maximum")},
                "undetectable": error.undetectable,
            }
            for name, error in comparison.bsr_error.items()
        },
        "bsr_difference_deg": dict(comparison.bsr_difference),
        "distance": {name: _distance(found) for name, found in comparison.distance.items()},
    }


def rows(record: Mapping[str, Any], where: str = "") -> Iterator[tuple[str, str, Any]]:
    """The numbers and words of a record, one row each: where, which measure, what."""
    for name, value in record.items():
        if isinstance(value, Mapping):
            yield from rows(value, f"{where} {name}".strip())
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            for number, entry in enumerate(value, start=1):
                yield from rows(entry, f"{where} {name} {number}".strip())
        else:
            yield where, name, " ".join(map(str, value)) if isinstance(value, list) else value


def _distance(found: DistanceStatistics | None) -> dict[str, float] | None:
    if found is None:
        return None
    values = dataclasses.asdict(found)
    return {"area_cm2": values.pop("area"), **{f"{name}_mm": value for name, value in values.items()}}
