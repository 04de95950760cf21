"""The files of a calibration: tissue.toml, and beside it what is known of it as JSON and as a page."""

from __future__ import annotations

from datetime import date
from pathlib import Path

from warp_trunk.case.tissue_file import write_tissue_file
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import short_digest
from warp_trunk.io.atomic_write import json_text, write_whole
from warp_trunk.io.folders import make_writable
from warp_trunk.report.page import rendered, sheet_line

from .calibrate import Calibration, FittedConstant


def check_tissue_file(path: Path) -> None:
    """Raise InputError where the files cannot be written."""
    if path.suffix != ".toml":
        raise InputError(f"{path}: must end in .toml, as simulate --tissue-file reads it; call it tissue.toml")
    make_writable(path.parent, "a calibration")


def write_calibration(path: Path, calibration: Calibration) -> Path:
    """Writes what was found; returns the page."""
    remarks = [
        f"found by warp-trunk calibrate on {len(calibration.cases)} cases of {calibration.patients} patients",
        *(["SYNTHETIC: these cases were made by a computer"] if calibration.synthetic else []),
        *(f"{fitted.name}: {fitted.low:.4g} to {fitted.high:.4g} (95 %)" for fitted in calibration.constants),
    ]
    page = path.with_suffix(".html")
    record = json_text(calibration)
    sheet = sheet_line(path.stem, date.today().isoformat(), short_digest(record))
    write_whole(path.with_suffix(".json"), record)
    write_whole(page, calibration_page(calibration, sheet))
    write_tissue_file(path, {fitted.name: fitted.value for fitted in calibration.constants}, remarks)
    return page


def calibration_page(calibration: Calibration, sheet: str) -> str:
    """The text of the page, with a line for the foot of its sheets; all that comes from files is escaped."""
    return rendered(
        "calibration.html",
        {},
        calibration=calibration,
        sheet=sheet,
        warnings=calibration_warnings(calibration),
        gain=gain_text(calibration),
    )


def _percent(fitted: FittedConstant) -> str:
    return f"{100.0 * fitted.from_data:.0f} %"


def calibration_warnings(calibration: Calibration) -> list[str]:
    """The reasons to doubt the constants."""
    said = [f"{name} took no part: {reason}" for name, reason in calibration.left_out.items()]
    if not calibration.converged:
        said.append("The search did not come to its end; give other constants free, or more cases.")
    said += [
        f"{fitted.name}: {_percent(fitted)} of the information comes from these patients, the rest is the prior; "
        "do not fit it, or add patients."
        for fitted in calibration.constants
        if fitted.from_data < 0.5
    ]
    judged = {fit_of_case.case for fit_of_case in calibration.held_out}
    missing = ", ".join(name for name in calibration.cases if name not in judged) if judged else ""
    if missing:
        said.append(f"{missing}: no equilibrium with the constants of the others; not among the left-out backs.")
    if calibration.patients == 1:
        said.append("One patient: the intervals follow from the stated errors alone, and no patient is held out.")
    return said


def gain_text(calibration: Calibration) -> str:
    """Sentences on the prediction of held-out patients; empty for one patient."""
    gain = calibration.held_out_gain_mm
    if gain is None:
        return ""
    way = "nearer to" if gain.mean > 0.0 else "further from"
    text = f"A back that had no part in it comes {abs(gain.mean):.2f} mm {way} the actual one in the mean"
    if gain.low is not None and gain.high is not None:
        text += f" (95 % interval {gain.low:+z.2f} to {gain.high:+z.2f} mm, drawn over {gain.patients} patients)"
    return text + "."


def calibration_text(calibration: Calibration) -> str:
    """The text for the terminal."""
    lines = [f"{len(calibration.cases)} cases of {calibration.patients} patients, {calibration.rounds} rounds"]
    lines += [
        f"{c.name:<22} {c.value:10.4g}   95 %: {c.low:.4g} to {c.high:.4g}   (before {c.start:.4g}; "
        f"{_percent(c)} from the patients)"
        for c in calibration.constants
    ]
    lines.append(
        f"mean distance of the backs: {calibration.skin_before_mm:.2f} mm before, {calibration.skin_mm:.2f} after"
    )
    return "\n".join([*lines, *filter(None, [gain_text(calibration)]), *calibration_warnings(calibration)])
