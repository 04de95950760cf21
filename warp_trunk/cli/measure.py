"""warp-trunk measure"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from tyro.conf import Positional

from warp_trunk.case import Case, read_case
from warp_trunk.case.header import read_header
from warp_trunk.case.places import refuse_case
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import enclosed_volume, manifold_fault
from warp_trunk.io.surface_files import read_surface
from warp_trunk.io.trunk_file import read_trunk
from warp_trunk.measures import compare_skins, measure
from warp_trunk.measures.record import COLUMNS, comparison_record, measures_record, rows
from warp_trunk.measures.table import comparison_text, measures_text
from warp_trunk.measures.volume import tissue_volume_change
from warp_trunk.results import partial, read_result, read_summary
from warp_trunk.results.bands import levels_in_band
from warp_trunk.results.folder import PREDICTED_SKIN, TRUNK
from warp_trunk.results.summary import SUMMARY
from warp_trunk.run.progress import Progress

from .exit_status import OK


@dataclass(frozen=True, kw_only=True)
class Measure:
    """Measure a skin, simulated or scanned, and judge it by the actual one."""

    skin: Positional[Path]
    """A closed surface in mm and LPS axes (in those of the case if it lies in its folder), or a result folder."""
    case: Path | None = None
    """Case folder: its landmarks say where the vertebrae are. A result holds its own, so it needs none."""
    against: Path | None = None
    """The actual skin after surgery, closed; it may have triangles of its own."""
    when: Literal["before", "after"] | None = None
    """Which landmarks go with the skin; when left out, before surgery for the case's own skin, else after."""
    out: Path | None = None
    """Folder for measures.json and measures.csv, or their name without ending; beside the skin when left out."""

    def run(self, arguments: Sequence[str]) -> int:
        """Prints the measures and writes them."""
        file = self.skin / PREDICTED_SKIN if self.skin.is_dir() else self.skin
        stem = self.out or file.with_name(f"{file.stem}_measures")
        stem = stem / "measures" if stem.is_dir() else stem
        if self.out is not None:
            refuse_case(self.out)
        check_writable(stem)
        with Progress() as progress:
            with progress.stage("load", f"reading {file}"):
                case = patient_of(file, self.case)
                skin = read_skin(file, self.case)
                actual = None if self.against is None else read_skin(self.against, self.case)
                check_place(file, skin, case)
                if self.against is not None and actual is not None:
                    check_place(self.against, actual, case)
            with progress.stage("measure", "measuring"):
                record, text = measured(case, skin, actual, self.when)
                inside = in_bands(file, record)
                tissue = tissue_change(file, skin)
        record["tissue_volume_change_percent"] = tissue
        print(text)
        if inside is not None:
            record["against"]["in_band"] = inside
            print(f"\n{bands_text(inside)}")
        if tissue is not None:
            print(f"\nvolume of the soft tissue   {tissue:+.2f} %")
        write_record(stem, record)
        print(f"\nWritten to {stem}.json and {stem}.csv")
        return OK


def measured(
    case: Case, skin: Surface, actual: Surface | None, when: Literal["before", "after"] | None
) -> tuple[dict[str, Any], str]:
    """The record and the text of all measures of a skin, and of the actual one where there is one."""
    same = skin.vertices.shape == case.skin.vertices.shape and np.array_equal(skin.faces, case.skin.faces)
    if when is None:
        unmoved = same and np.abs(skin.vertices - case.skin.vertices).max() < 1e-3  # float32 files round
        when = "before" if unmoved else "after"
    landmarks = case.landmarks_before if when == "before" else case.planned_landmarks
    found = measure(skin, landmarks, case.skin if same and when == "after" else None)
    record: dict[str, Any] = {"case": case.name, "landmarks": when, "skin": measures_record(found)}
    text = [f"{case.name.strip()}: the skin with its landmarks {when} surgery", "", measures_text(found)]
    if actual is not None:
        other, comparison = measure(actual, landmarks), compare_skins(skin, actual, landmarks)
        record |= {"actual": measures_record(other), "against": comparison_record(comparison)}
        text += ["", "The actual skin", "", measures_text(other), "", comparison_text(comparison)]
    return record, "\n".join(text)


def in_bands(file: Path, record: dict[str, Any]) -> dict[str, bool | None] | None:
    """By level, whether the actual rotation lies in the band of the prediction; None where there is no band."""
    if "actual" not in record or file.name != PREDICTED_SKIN or not (file.parent / SUMMARY).is_file():
        return None
    bands = read_summary(file.parent).bands
    if bands is None:
        return None
    return levels_in_band(bands, {level: one["bsr_deg"] for level, one in record["actual"]["levels"].items()})


def bands_text(inside: dict[str, bool | None]) -> str:
    """How many levels of the actual back lie in their bands, and which do not."""
    known = [level for level, is_in in inside.items() if is_in is not None]
    out = [level for level in known if not inside[level]]
    text = f"Actual back surface rotation in its 95 % band at {len(known) - len(out)} of {len(known)} levels"
    return text + (f"; not at {', '.join(out)}" if out else "")


def tissue_change(file: Path, skin: Surface) -> float | None:
    """Change of the tissue's volume [%] where the skin is that of a simulation whose mesh lies beside it."""
    mesh = file.with_name(TRUNK)
    if not mesh.is_file():
        return None
    trunk, displacement = read_trunk(mesh)
    ours = (trunk.nodes + displacement)[trunk.skin_nodes]
    if ours.shape != skin.vertices.shape or np.abs(ours - skin.vertices).max() > 1e-3:
        return None
    return tissue_volume_change(trunk, displacement)


def patient_of(file: Path, folder: Path | None) -> Case:
    """The case whose landmarks go with a skin: that of the result it lies in, else of a folder.

    Raises:
        InputError: neither is there, or the folder is of another patient than the result.
    """
    own = None
    if (file.parent / SUMMARY).is_file():
        result = read_result(file.parent)
        before, after = result.landmarks_before, result.landmarks_after
        own = Case(result.summary.case, result.skin_before, {}, before, after)
    if folder is None:
        if own is None:
            raise InputError(f"{file}: does not lie in a result, which holds its landmarks; give --case CASE")
        return own
    case = read_case(folder)
    if own is None:
        return case
    mine, its = own.landmarks_before, case.landmarks_before
    if mine.names != its.names or np.abs(mine.points - its.points).max() > 1e-3:
        raise InputError(
            f"{folder}: is not the case of the result {file.parent}: their landmarks before surgery differ; "
            "leave --case out, the result holds its own landmarks"
        )
    return own


def read_skin(path: Path, case_folder: Path | None) -> Surface:
    """A skin of the patient in LPS and mm, closed and oriented outward.

    Raises:
        InputError: it cannot be read, or it is open or inside out.
    """
    surface = read_surface(path)
    if case_folder is not None and case_folder.resolve() in path.resolve().parents:
        header = read_header(case_folder / "case.toml")
        surface = header.axes.surface_to_lps(surface, header.units)
    fault = manifold_fault(surface)
    if fault is not None:
        raise InputError(
            f"{path}: a skin must be closed to be measured, but {fault}; close it with warp-trunk close"
        )
    volume = enclosed_volume(surface)
    if volume <= 0.0:
        raise InputError(
            f"{path}: triangles must be counterclockwise seen from outside, they hold {volume / 1000:.3g} cm3; "
            "turn them round"
        )
    return surface


def check_place(path: Path, surface: Surface, case: Case) -> None:
    """Raise InputError where a surface lies elsewhere than the skin of the case, or is of another size."""
    (low, high), (own_low, own_high) = (
        (one.vertices.min(axis=0), one.vertices.max(axis=0)) for one in (surface, case.skin)
    )
    if (
        (low > own_high).any()
        or (high < own_low).any()
        or not 0.5 < (high[2] - low[2]) / (own_high[2] - own_low[2]) < 2
    ):
        raise InputError(
            f"{path}: must lie where the skin of the case is, z {own_low[2]:.0f} to {own_high[2]:.0f} mm, "
            f"but has z {low[2]:.0f} to {high[2]:.0f}; give it in mm and LPS axes, registered to the case"
        )


def check_writable(stem: Path) -> None:
    """Make the folder of a record, and raise InputError where the record cannot be written."""
    probe = stem.with_name(f".{stem.name}.writable")
    try:
        stem.parent.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"{stem}: measures cannot be written here ({error.strerror}); give --out a place of your own"
        ) from error


def write_record(stem: Path, record: dict[str, Any]) -> None:
    """Write a record as JSON and as CSV, each whole or not at all."""
    as_json, as_csv = (stem.with_name(f"{stem.name}{ending}") for ending in (".json", ".csv"))
    partial(as_json).write_text(json.dumps(record, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    with partial(as_csv).open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows(record)])
    for path in (as_json, as_csv):
        os.replace(partial(path), path)
