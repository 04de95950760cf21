"""A skin measured, and compared with the actual one if it is known, as `measure` prints and writes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np

from warp_trunk.case import Case
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.atomic_write import csv_text, json_text, write_whole
from warp_trunk.measures import compare_skins, measure
from warp_trunk.measures.body_part import agreement, tissue_volume_change
from warp_trunk.measures.comparison import comparison_rows
from warp_trunk.measures.quantities import ACTUAL, COLUMNS, PREDICTED, Measured, MeasureTable, measured
from warp_trunk.measures.rows import comparison_text, measures_text
from warp_trunk.spine import CobbAngle
from warp_trunk.spine.apical import ApicalVertebra

from .result import Result


@dataclass(frozen=True, eq=False, kw_only=True)
class Judgement:
    """All that is known of a skin, and of how it agrees with the actual one."""

    case: str
    """Name of the case."""
    landmarks: str
    """Whose landmarks were used, before or after."""
    table: MeasureTable
    """Every number: of the skin, of the actual one, and of the state `error`."""
    curves: tuple[CobbAngle, ...]
    """Curves of the spine."""
    apices: tuple[ApicalVertebra, ...]
    """The apical vertebra of each."""
    missing: dict[str, str]
    """Why a measure of the skin is missing, by level or by the name of the measure."""
    tissue_volume_change_percent: float | None
    """Change of the tissue's volume [%]; None where the mesh is not known."""
    text: str
    """The same in words and tables."""

    @property
    def words(self) -> dict[str, Any]:
        """All but the table and the text."""
        record = {
            field.name: getattr(self, field.name) for field in fields(self) if field.name not in ("table", "text")
        }
        return record | {"levels_in_band": self.levels_in_band}

    @property
    def levels_in_band(self) -> dict[str, bool | None]:
        """By level, whether the actual rotation lies in the interval of the prediction; empty without
        intervals."""
        return levels_in_band(self.table)


def levels_in_band(table: MeasureTable) -> dict[str, bool | None]:
    """Whether the actual rotation of each level lies in its interval; empty where there is none."""
    predicted, actual = table.column(PREDICTED, "bsr_deg"), table.values(ACTUAL, "bsr_deg")
    if not actual or all(row.low is None for row in predicted.values()):
        return {}
    return {level: row.holds(actual.get(level)) for level, row in predicted.items()}


def judged(
    case: Case,
    skin: Surface,
    actual: Surface | None,
    when: Literal["before", "after"] | None,
    result: Result | None = None,
) -> Judgement:
    """All that is known of a skin.

    Args:
        case: whose skin it is, with its landmarks.
        skin: the skin [mm].
        actual: the actual skin after surgery, where it is to be judged.
        when: whose landmarks go with it; found out where left out.
        result: the result whose predicted skin it is; its measures, intervals and tissue are taken.
    """
    same = skin.vertices.shape == case.skin.vertices.shape and np.array_equal(skin.faces, case.skin.faces)
    if when is None:
        unmoved = same and np.abs(skin.vertices - case.skin.vertices).max() < 1e-3  # float32 files round
        when = "before" if unmoved else "after"
    landmarks = case.landmarks_before if when == "before" else case.planned_landmarks
    if result is not None and when == "after":
        measures, before = result.measures, result.measures_before
        table = MeasureTable(row for row in result.table.rows if row.state == PREDICTED)
    else:
        unseen = case.unseen if same else None
        measures = measure(skin, landmarks, case.skin if same and when == "after" else None, unseen)
        before = measure(case.skin, case.landmarks_before, unseen=case.unseen)
        table = MeasureTable(measured(when, measures, before))
    name = case.name.strip()
    text = [f"{name}: the skin with its landmarks {when} surgery", "", measures_text(measures, before)]
    if not landmarks.names:
        change = measures.skin_change_max
        text = [f"{name}: the skin" + ("" if change is None else f" moves by {change:.1f} mm")]
    if actual is not None and not landmarks.names:
        agreed = agreement(skin, actual)
        table = table.with_rows(agreed.measured("error"))
        text += ["", *(f"{name}: {value}" for name, value in agreed.rows())]
    elif actual is not None:
        other = measure(actual, landmarks)
        comparison = compare_skins(skin, actual, landmarks, (measures.bsr, other.bsr))
        table = table.with_rows([*measured(ACTUAL, other, before, of="skin"), *comparison_rows(comparison)])
        text += ["", "The actual skin", "", measures_text(other, before), "", comparison_text(comparison)]
    inside = levels_in_band(table)
    if sides := [level for level, is_in in inside.items() if is_in is not None]:
        out = [level for level in sides if not inside[level]]
        counts = f"{len(sides) - len(out)} of {len(sides)} levels" + (f"; not at {', '.join(out)}" if out else "")
        text += ["", f"Actual back surface rotation in its 95 % band at {counts}"]
    tissue = None if result is None else tissue_volume_change(*result.tissue)
    if tissue is not None:
        text += ["", f"volume of the soft tissue   {tissue:+z.2f} %"]
    return Judgement(
        case=case.name,
        landmarks=when,
        table=table,
        curves=measures.cobb,
        apices=measures.apices,
        missing=measures.missing,
        tissue_volume_change_percent=tissue,
        text="\n".join(text),
    )


def write_measures(stem: Path, words: Mapping[str, Any], rows: Sequence[Measured]) -> None:
    """Write a table of measures as JSON, with words beside it, and as CSV, each whole or not at all."""
    write_whole(stem.with_name(f"{stem.name}.json"), json_text({**words, "measures": rows}))
    write_whole(stem.with_name(f"{stem.name}.csv"), csv_text([COLUMNS, *map(astuple, rows)]))
