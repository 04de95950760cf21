"""A calibration: constants that fit the actual skins of several patients best, judged on each patient left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..statistics import Estimate, over_patients
from .fit import Prior, certainty, without
from .free_constants import FreeConstant, values_of
from .one_fit import CaseFit, FitJob
from .rounds import Rounds

if TYPE_CHECKING:
    from distributed import Client

    from warp_trunk.run.progress import Progress


@dataclass(frozen=True, kw_only=True)
class Found:
    """One constant that was found."""

    name: str
    """Its name in tissue.toml."""
    start: float
    """Where the search began, the middle of what was believed."""
    value: float
    """The value that fits best."""
    low: float
    """Where the interval begins that holds it in 19 of 20 studies ..."""
    high: float
    """... and where it ends."""
    from_data: float
    """Fraction of the information about it that comes from the patients, from 0 to 1; the rest is the prior."""


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """A case predicted with constants that its own patient had no part in."""

    case: str
    """Name of its folder."""
    patient: str
    """Whose it is."""
    constants: dict[str, float]
    """Its value, found on the other patients."""
    skin_before_mm: float
    """Mean distance of its back from the actual one with the constants from which the search began [mm]."""
    skin_mm: float
    """The same with those of the others [mm]."""
    bsr_before_deg: float | None
    """Mean absolute error of its back surface rotation, likewise [degrees]."""
    bsr_deg: float | None
    """The same with those of the others [degrees]."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """The result of a calibration."""

    found: tuple[Found, ...]
    """Every free constant."""
    correlation: tuple[tuple[float, ...], ...]
    """Between the errors of each two, in the same order."""
    cases: tuple[str, ...]
    """The cases that took part."""
    patients: int
    """Of how many patients."""
    poses: tuple[str, ...]
    """The pose of their second scan: after surgery, or bending."""
    synthetic: int
    """How many of them a computer made."""
    left_out: dict[str, str]
    """Cases that did not take part in what was found, and why."""
    rounds: int
    """Rounds over all cases."""
    converged: bool
    """Whether the search came to its end."""
    skin_before_mm: float
    """Mean distance of the backs at the start [mm], over cases."""
    skin_mm: float
    """The same at the end [mm]."""
    held_out: tuple[HeldOut, ...]
    """Each case without its patient; empty for one patient."""
    held_out_gain_mm: Estimate | None
    """How much nearer a left-out back comes to the actual one [mm], over patients."""


def calibrate(
    client: Client,
    jobs: Sequence[FitJob],
    free: Sequence[FreeConstant],
    progress: Progress,
    *,
    priors: bool = True,
) -> Calibration:
    """Finds constants on all cases, then on all but each patient.

    Raises:
        InputError: no case could be simulated.
    """
    rounds, prior = Rounds(client, jobs, progress), prior_of(free, priors)
    fit = rounds.search(prior)
    sure, cases = certainty(fit.pieces, prior), rounds.jobs
    first, last = rounds.at(prior.mean), rounds.at(fit.counted)
    found = [
        Found(
            name=one.name,
            start=one.start,
            value=one.value(float(x)),
            low=one.value(max(float(x - sure.width * sd), one.limits[0])),
            high=one.value(min(float(x + sure.width * sd), one.limits[1])),
            from_data=float(share),
        )
        for one, x, sd, share in zip(free, fit.counted, sure.sd, sure.from_data, strict=True)
    ]
    held_out: list[HeldOut] = []
    if len(fit.pieces) > 1:  # every case with the constants of the other patients, simulated
        others = {patient: without(fit.pieces, patient, fit.counted, prior) for patient in fit.pieces}
        left = rounds.submitted([(replace(job, derivative=False), others[job.patient]) for job in cases])
        held_out = [
            HeldOut(
                case=job.name,
                patient=job.patient,
                constants=values_of(free, others[job.patient]),
                skin_before_mm=first[job.name].skin_mm,
                skin_mm=one.skin_mm,
                bsr_before_deg=first[job.name].bsr_deg,
                bsr_deg=one.bsr_deg,
            )
            for job in cases
            if isinstance(one := left[job.name], CaseFit)
        ]
    gains = [one.skin_before_mm - one.skin_mm for one in held_out]
    return Calibration(
        found=tuple(found),
        correlation=tuple(tuple(map(float, row)) for row in sure.correlation),
        cases=tuple(job.name for job in cases),
        patients=len(fit.pieces),
        poses=tuple(sorted({job.study.pose for job in cases})),
        synthetic=sum(job.study.synthetic for job in cases),
        left_out=rounds.left_out,
        rounds=rounds.count,
        converged=fit.converged,
        skin_before_mm=float(np.mean([first[job.name].skin_mm for job in cases])),
        skin_mm=float(np.mean([last[job.name].skin_mm for job in cases])),
        held_out=tuple(held_out),
        held_out_gain_mm=over_patients(gains, [one.patient for one in held_out]),
    )


def prior_of(free: Sequence[FreeConstant], weight: bool) -> Prior:
    """The prior of the constants; without priors only their limits."""
    low, high = np.array([one.limits for one in free]).T
    mean, sd = np.array([(one.counted(one.start), one.believed) for one in free]).T
    return Prior(mean=mean, sd=sd, low=low, high=high, weight=float(weight))
