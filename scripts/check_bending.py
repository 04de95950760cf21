"""Whether the constants that a patient's bending sideways tells predict her surgery better.

    python scripts/check_bending.py patients --free poisson_ratio ribs.recovery --bones follow --energy neo-hookean

CASES holds of each patient one case that bends and one of surgery, both with an actual skin, as
`make_cohort.py --bending` writes them. Her constants are found on the first, as `calibrate` does; her surgery is
simulated with those of the start, with hers, and where truth.json lies beside the cases with the true ones.
Prints a row for each patient, how sure of each constant her bending makes one, and means over patients.
docs/calibration.md tells what it gave.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from warp_trunk.case import read_checked_case
from warp_trunk.case.study import Pose
from warp_trunk.case.tissue_file import constant_of
from warp_trunk.cohort.calibration.calibrate import Found, calibrate
from warp_trunk.cohort.calibration.free_constants import FreeConstant, check_free
from warp_trunk.cohort.calibration.one_fit import CaseFit, FitJob, tried
from warp_trunk.cohort.calibration.rounds import FitCase
from warp_trunk.cohort.case_folders import case_folders
from warp_trunk.cohort.cluster import connected
from warp_trunk.cohort.statistics.estimate import Estimate, over_patients
from warp_trunk.errors import InputError
from warp_trunk.run.options import RunOptions
from warp_trunk.run.progress import Progress


@dataclass(frozen=True, kw_only=True)
class Options:
    """What is checked."""

    cases: tyro.conf.Positional[Path]
    """Folder with case folders."""
    free: tuple[str, ...]
    """Constants that bending tells."""
    workers: int = 0
    """Patients at the same time; 0 is as many as fit this machine."""
    run: tyro.conf.OmitArgPrefixes[RunOptions] = field(default_factory=RunOptions)
    """How cases are simulated."""


@dataclass(frozen=True)
class Checked:
    """A patient's surgery with the constants of the start, with hers, and with the true ones where known."""

    patient: str
    constants: dict[str, dict[str, float]]
    """By `start`, `hers`, `truth`."""
    found: tuple[Found, ...]
    """Hers, with their intervals."""
    fits: dict[str, CaseFit | InputError]
    """The same; an error where her surgery found no equilibrium."""


def main(options: Options) -> list[Checked]:
    """Prints the rows."""
    truth = options.cases / "truth.json"
    drawn = json.loads(truth.read_text()) if truth.is_file() else {}
    known = {name: one["constants"] for name, one in drawn.items()}
    patients = list(pairs(options))
    with (
        connected(options.workers, None, options.run.device) as client,
        ThreadPoolExecutor(len(client.scheduler_info()["workers"])) as pool,
    ):
        done = list(
            pool.map(lambda both: checked(client, both[0], both[1], known.get(both[1].name, {})), patients)
        )
    for one in done:
        print(one.patient)
        for name, fit in one.fits.items():
            print(f"  {name:<6} {row(fit)}   {', '.join(f'{n} {v:.3f}' for n, v in one.constants[name].items())}")
    for constant in options.free:
        print(f"{constant}: {sure(done, constant)}")
    for what in ("skin_mm", "bsr_deg"):
        print(f"{what}: nearer by {told(gain(done, what))} with hers than at the start")
    return done


def pairs(options: Options) -> Iterator[tuple[FitCase, FitCase]]:
    """Bending and surgery of every patient who has both.

    Raises:
        InputError: nobody has, or a constant that no skin tells.
    """
    of: dict[str, dict[Pose, FitCase]] = {}
    for folder in case_folders(options.cases):
        case, _ = read_checked_case(folder)
        check_free(options.free, case, options.run)
        job = FitJob(
            folder=folder.resolve(),
            options=options.run,
            align_pelvis=False,
            refine=None,
            free=tuple(FreeConstant(name=name, start=constant_of(case, name)) for name in options.free),
        )
        patient, pose = case.study.patient or folder.name, case.study.pose
        of.setdefault(patient, {})[pose] = FitCase(
            name=folder.name, patient=patient, pose=pose, virtual=case.study.virtual, job=job
        )
    both = [one for one in of.values() if len(one) == 2]
    if not both:
        raise InputError(
            f"{options.cases}: nobody has a case that bends and one of surgery; see docs/calibration.md"
        )
    yield from ((one["bending"], one["surgery"]) for one in both)


def checked(client: Any, bending: FitCase, surgery: FitCase, known: dict[str, float]) -> Checked:
    """One patient."""
    free = bending.job.free
    found = calibrate(client, [bending], free, Progress()).found
    constants = {
        "start": {one.name: one.start for one in free},
        "hers": {one.name: one.value for one in found},
    }
    if all(one.name in known for one in free):
        constants["truth"] = {one.name: known[one.name] for one in free}
    futures = [
        client.submit(tried, surgery.job, np.array([one.counted(values[one.name]) for one in free]), pure=False)
        for values in constants.values()
    ]
    return Checked(surgery.patient, constants, found, dict(zip(constants, client.gather(futures), strict=True)))


def row(fit: CaseFit | InputError) -> str:
    """How far a prediction lies from the actual back."""
    return (
        str(fit) if isinstance(fit, InputError) else f"{fit.skin_mm:.3f} mm, {fit.bsr_deg or np.nan:.3f} degrees"
    )


def sure(done: list[Checked], constant: str) -> str:
    """What the patients found of a constant, how much of it they told, and whose interval holds the truth."""
    found = {one.patient: next(hers for hers in one.found if hers.name == constant) for one in done}
    values, told_by = [one.value for one in found.values()], [100.0 * one.from_data for one in found.values()]
    text = (
        f"found {min(values):.3f} to {max(values):.3f}, told by her {min(told_by):.0f} to {max(told_by):.0f} %, "
        f"intervals {min(one.low for one in found.values()):.3f} to {max(one.high for one in found.values()):.3f}"
    )
    true = {one.patient: one.constants["truth"][constant] for one in done if "truth" in one.constants}
    missed = [name for name, value in true.items() if not found[name].low <= value <= found[name].high]
    held = f", {len(true) - len(missed)} of {len(true)} hold the truth" if true else ""
    return text + held + (f", not {', '.join(missed)}" if missed else "")


def gain(done: list[Checked], what: str) -> Estimate | None:
    """How much nearer hers come than those of the start, over patients of whom both found an equilibrium."""
    both = {one.patient: (one.fits["start"], one.fits["hers"]) for one in done}
    gains = {
        patient: getattr(start, what) - getattr(hers, what)
        for patient, (start, hers) in both.items()
        if isinstance(start, CaseFit) and isinstance(hers, CaseFit)
    }
    return over_patients(list(gains.values()), list(gains))


def told(gain: Estimate | None) -> str:
    """A mean with its interval."""
    if gain is None or gain.low is None or gain.high is None:
        return "-" if gain is None else f"{gain.mean:.3f}"
    return f"{gain.mean:.3f} (95 % {gain.low:.3f} to {gain.high:.3f}, {gain.patients} patients)"


if __name__ == "__main__":
    try:
        main(tyro.cli(Options, description=__doc__))
    except InputError as error:
        raise SystemExit(str(error)) from error
