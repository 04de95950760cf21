"""A skin measured, and compared with the actual one if it is known, as `measure` prints and writes it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from warp_trunk.io.atomic_write import csv_text, write_whole
from warp_trunk.io.result_files import PREDICTED_SKIN, SUMMARY, TRUNK
from warp_trunk.io.trunk_file import read_trunk
from warp_trunk.measures import compare_skins, measure
from warp_trunk.measures.part import agreement, agreement_rows, tissue_volume_change
from warp_trunk.measures.record import COLUMNS, comparison_record, measures_record, rows
from warp_trunk.measures.table import comparison_text, measures_text

from .bands import levels_in_band
from .summary import read_summary

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.geometry.surface import Surface


def judged(
    case: Case, file: Path, skin: Surface, actual: Surface | None, when: Literal["before", "after"] | None
) -> tuple[dict[str, Any], str]:
    """The record and the text of all that is known of a skin that was read from a file.

    Args:
        case: whose skin it is, with its landmarks.
        file: where the skin was read from; in a result, its bands and the volume of its tissue are included.
        skin: the skin [mm].
        actual: the actual skin after surgery, where it is to be judged.
        when: whose landmarks go with it; found out where left out.
    """
    record, text = _measured(case, skin, actual, when)
    if (inside := _in_bands(file, record)) is not None:
        record["against"]["in_band"] = inside
        known = [level for level, is_in in inside.items() if is_in is not None]
        out = [level for level in known if not inside[level]]
        counts = f"{len(known) - len(out)} of {len(known)} levels" + (f"; not at {', '.join(out)}" if out else "")
        text += f"\n\nActual back surface rotation in its 95 % band at {counts}"
    record["tissue_volume_change_percent"] = tissue = _tissue_change(file, skin)
    if tissue is not None:
        text += f"\n\nvolume of the soft tissue   {tissue:+z.2f} %"
    return record, text


def _measured(
    case: Case, skin: Surface, actual: Surface | None, when: Literal["before", "after"] | None
) -> tuple[dict[str, Any], str]:
    """The record and the text of all measures of a skin, and of the actual one where there is one."""
    same = skin.vertices.shape == case.skin.vertices.shape and np.array_equal(skin.faces, case.skin.faces)
    if when is None:
        unmoved = same and np.abs(skin.vertices - case.skin.vertices).max() < 1e-3  # float32 files round
        when = "before" if unmoved else "after"
    landmarks = case.landmarks_before if when == "before" else case.planned_landmarks
    spine, name = bool(landmarks.names), case.name.strip()
    found = measure(skin, landmarks, case.skin if same and when == "after" else None)
    record: dict[str, Any] = {"case": case.name, "landmarks": when, "skin": measures_record(found)}
    text = [f"{name}: the skin with its landmarks {when} surgery", "", measures_text(found)]
    if not spine:
        change = found.skin_change_max
        text = [f"{name}: the skin" + ("" if change is None else f" moves by {change:.1f} mm")]
    if actual is not None and not spine:
        agreed, _ = agreement(skin, actual)
        text += ["", *(f"{name}: {value}" for name, value in agreement_rows(agreed))]
        record["against"] = agreed
    elif actual is not None:
        other, comparison = measure(actual, landmarks), compare_skins(skin, actual, landmarks)
        record |= {"actual": measures_record(other), "against": comparison_record(comparison)}
        text += ["", "The actual skin", "", measures_text(other), "", comparison_text(comparison)]
    return record, "\n".join(text)


def _in_bands(file: Path, record: dict[str, Any]) -> dict[str, bool | None] | None:
    """By level, whether the actual rotation lies in the band of the prediction; None where there is no band."""
    if "actual" not in record or file.name != PREDICTED_SKIN or not (file.parent / SUMMARY).is_file():
        return None
    bands = read_summary(file.parent).bands
    angles = {level: one["bsr_deg"] for level, one in record["actual"]["levels"].items()}
    return None if bands is None else levels_in_band(bands, angles)


def _tissue_change(file: Path, skin: Surface) -> float | None:
    """Change of the tissue's volume [%] where the skin is that of a simulation whose mesh lies beside it."""
    mesh = file.with_name(TRUNK)
    if not mesh.is_file():
        return None
    trunk, displacement = read_trunk(mesh)
    ours = (trunk.nodes + displacement)[trunk.skin_nodes]
    if ours.shape != skin.vertices.shape or np.abs(ours - skin.vertices).max() > 1e-3:
        return None
    return tissue_volume_change(trunk, displacement)


def write_record(stem: Path, record: Mapping[str, Any]) -> None:
    """Write a record as JSON and as CSV, each whole or not at all."""
    write_whole(stem.with_name(f"{stem.name}.json"), json.dumps(record, indent=2, allow_nan=False) + "\n")
    write_whole(stem.with_name(f"{stem.name}.csv"), csv_text([COLUMNS, *rows(record)]))
