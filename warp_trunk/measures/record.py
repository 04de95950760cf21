"""Measures in plain JSON types, and the same as rows of a table; a unit ends each name."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .apical import ApicalVertebra
    from .cobb import CobbAngle
    from .comparison import SkinComparison
    from .measures import TrunkMeasures
    from .skin_distance import DistanceStatistics

COLUMNS = ("where", "measure", "value")
"""Header of the rows."""


def measures_record(measures: TrunkMeasures) -> dict[str, Any]:
    """Measures of one skin; None is missing, and `missing` says why."""
    return {
        "max_thoracic_bsr_deg": measures.max_thoracic_bsr,
        "max_lumbar_bsr_deg": measures.max_lumbar_bsr,
        "max_hump_mm": measures.max_hump,
        "max_hump_level": measures.hump_level,
        "trunk_shift_mm": None if measures.trunk_shift is None else measures.trunk_shift.lateral,
        "trunk_shift_forward_mm": None if measures.trunk_shift is None else measures.trunk_shift.forward,
        "trunk_shift_of": None if measures.trunk_shift is None else measures.trunk_shift.upper,
        "trunk_shift_over": None if measures.sacral_line is None else measures.sacral_line.landmark,
        "shoulder_difference_mm": None if measures.shoulders is None else measures.shoulders.difference,
        "kyphosis_deg": dict(measures.kyphosis),
        "lordosis_deg": dict(measures.lordosis),
        "spine_height_mm": None if measures.spine_height is None else measures.spine_height.height,
        "spine_height_over": None if measures.spine_height is None else measures.spine_height.lower,
        "skin_change_max_mm": measures.skin_change_max,
        "skin_change_mean_mm": measures.skin_change_mean,
        "curves": [_curve(curve, apex) for curve, apex in zip(measures.cobb, measures.apices, strict=True)],
        "levels": {level: _level(measures, level) for level in measures.tangents},
        "missing": dict(measures.missing),
    }  # fmt: skip


def comparison_record(comparison: SkinComparison) -> dict[str, Any]:
    """A prediction against the actual skin, without its values by vertex."""
    return {
        "bsr_error": {
            name: None
            if error is None
            else {
                "levels": list(error.levels),
                "mean_deg": error.mean,
                "sd_deg": error.sd,
                "of_maximum_deg": error.of_maximum,
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


def _curve(curve: CobbAngle, apex: ApicalVertebra) -> dict[str, Any]:
    return {
        "cobb_deg": curve.angle,
        "upper": curve.upper,
        "lower": curve.lower,
        "apex": curve.apex,
        "convex": curve.convex,
        "apical_rotation_deg": apex.rotation,
        "apical_translation_mm": apex.translation,
        "apical_translation_from": apex.line,
        "neutral_above": apex.neutral_above,
        "neutral_below": apex.neutral_below,
    }


def _level(measures: TrunkMeasures, level: str) -> dict[str, float | None]:
    flanks = measures.flanks[level]
    return {
        "bsr_deg": measures.bsr[level],
        "axial_rotation_deg": measures.axial_rotation[level],
        "hump_mm": measures.hump_height[level],
        "left_flank_mm": None if flanks is None else flanks.left,
        "right_flank_mm": None if flanks is None else flanks.right,
        "flank_asymmetry_percent": None if flanks is None else flanks.index,
    }


def _distance(found: DistanceStatistics | None) -> dict[str, float] | None:
    if found is None:
        return None
    values = dataclasses.asdict(found)
    return {"area_cm2": values.pop("area"), **{f"{name}_mm": value for name, value in values.items()}}
