"""A calibration: constants that fit the actual skins of several patients best, judged on each patient left out."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..statistics import Estimate, over_patients
from .fit import Certainty, Fit, Prior, certainty, without
from .free_constants import FreeConstant
from .one_fit import CaseFit
from .rounds import FitCase, Rounds

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
    virtual: int
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
    cases: Sequence[FitCase],
    free: Sequence[FreeConstant],
    progress: Progress,
    *,
    priors: bool = True,
) -> Calibration:
    """Finds constants on all cases, then on all but each patient.

    Raises:
        InputError: no case could be simulated.
    """
    rounds = Rounds(client, cases, progress)
    prior = prior_of(free, priors)
    fit = rounds.search(prior)
    sure = certainty(fit.pieces, prior)
    first, last = rounds.at(prior.mean), rounds.at(fit.counted)
    held_out = _held_out(rounds, fit, prior, free) if len(fit.pieces) > 1 else ()
    return Calibration(
        found=tuple(_found(free, fit, sure)),
        correlation=tuple(tuple(float(one) for one in row) for row in sure.correlation),
        cases=tuple(case.name for case in rounds.cases),
        patients=len(fit.pieces),
        poses=tuple(sorted({case.pose for case in rounds.cases})),
        virtual=sum(case.virtual for case in rounds.cases),
        left_out=rounds.left_out,
        rounds=rounds.count,
        converged=fit.converged,
        skin_before_mm=float(np.mean([first[case.name].skin_mm for case in rounds.cases])),
        skin_mm=float(np.mean([last[case.name].skin_mm for case in rounds.cases])),
        held_out=held_out,
        held_out_gain_mm=over_patients(
            [one.skin_before_mm - one.skin_mm for one in held_out], [one.patient for one in held_out]
        ),
    )


def prior_of(free: Sequence[FreeConstant], weight: bool) -> Prior:
    """The prior of the constants; without priors only their limits."""
    limits = np.array([one.limits for one in free])
    return Prior(
        mean=np.array([one.counted(one.start) for one in free]),
        sd=np.array([one.believed for one in free]),
        low=limits[:, 0],
        high=limits[:, 1],
        weight=float(weight),
    )


def _found(free: Sequence[FreeConstant], fit: Fit, sure: Certainty) -> list[Found]:
    return [
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


def _held_out(rounds: Rounds, fit: Fit, prior: Prior, free: Sequence[FreeConstant]) -> tuple[HeldOut, ...]:
    """Every case with the constants of the other patients, simulated."""
    others = {patient: without(fit.pieces, patient, fit.counted, prior) for patient in fit.pieces}
    jobs = [(case, dataclasses.replace(case.job, derivative=False), others[case.patient]) for case in rounds.cases]
    results, first = rounds.submitted(jobs), rounds.at(prior.mean)
    return tuple(
        HeldOut(
            case=case.name,
            patient=case.patient,
            constants={one.name: one.value(float(x)) for one, x in zip(free, others[case.patient], strict=True)},
            skin_before_mm=first[case.name].skin_mm,
            skin_mm=one.skin_mm,
            bsr_before_deg=first[case.name].bsr_deg,
            bsr_deg=one.bsr_deg,
        )
        for case in rounds.cases
        if isinstance(one := results[case.name], CaseFit)
    )
