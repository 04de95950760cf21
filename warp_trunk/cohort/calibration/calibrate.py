"""A calibration: constants that fit the actual skins of several patients best, judged on each patient left out."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError

from ..statistics.estimate import Estimate, over_patients
from .fit import Certainty, Fit, Piece, Prior, certainty, find, without
from .free_constants import FreeConstant
from .one_fit import CaseFit, FitJob, tried

if TYPE_CHECKING:
    from distributed import Client

    from warp_trunk.run.progress import Progress


WORSE = 3.0
"""How much larger residuals are taken to be at constants with which a case finds no equilibrium."""


@dataclass(frozen=True, kw_only=True)
class FitCase:
    """A case of a calibration."""

    name: str
    """Name of its folder."""
    patient: str
    """Whose it is."""
    pose: str
    """Surgery or bending."""
    virtual: bool
    """Whether a computer made it."""
    job: FitJob
    """What is asked of a worker."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """One constant that was found."""

    name: str
    """Its name in tissue.toml."""
    start: float
    """Where the search began, the middle of what was believed."""
    value: float
    """What fits best."""
    low: float
    """Where the interval begins that holds it in 19 of 20 studies ..."""
    high: float
    """... and where it ends."""
    from_data: float
    """Part of what is known of it that the patients told, from 0 to 1; the rest is what was believed before."""


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """A case predicted with constants that its own patient had no part in."""

    case: str
    """Name of its folder."""
    patient: str
    """Whose it is."""
    constants: dict[str, float]
    """What the other patients found."""
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
    """What a calibration found."""

    found: tuple[Found, ...]
    """Every free constant."""
    correlation: tuple[tuple[float, ...], ...]
    """Between the errors of each two, in the same order."""
    cases: tuple[str, ...]
    """The cases that took part."""
    patients: int
    """Of how many patients."""
    poses: tuple[str, ...]
    """What lies between before and after in them."""
    virtual: int
    """How many of them a computer made."""
    left_out: dict[str, str]
    """Cases that did not take part, and why."""
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
    rounds = _Rounds(client, cases, progress)
    prior = prior_of(free, priors)
    fit = find(rounds, prior)
    sure = certainty(fit.pieces, prior)
    first, last = rounds.at(prior.mean), rounds.at(fit.counted)
    held_out = _held_out(rounds, fit, prior, free) if len(fit.pieces) > 1 else ()
    return Calibration(
        found=tuple(_found(free, fit, sure)),
        correlation=tuple(tuple(float(one) for one in row) for row in sure.correlation),
        cases=tuple(last),
        patients=len(fit.pieces),
        poses=tuple(sorted({case.pose for case in rounds.cases})),
        virtual=sum(case.virtual for case in rounds.cases),
        left_out=rounds.left_out,
        rounds=fit.rounds,
        converged=fit.converged,
        skin_before_mm=float(np.mean([one.skin_mm for one in first.values()])),
        skin_mm=float(np.mean([one.skin_mm for one in last.values()])),
        held_out=held_out,
        held_out_gain_mm=over_patients(
            [one.skin_before_mm - one.skin_mm for one in held_out], [one.patient for one in held_out]
        ),
    )


def prior_of(free: Sequence[FreeConstant], weight: bool) -> Prior:
    """What is believed of constants; without weight only their limits."""
    limits = np.array([one.limits for one in free])
    return Prior(
        mean=np.array([one.counted(one.start) for one in free]),
        sd=np.array([one.believed for one in free]),
        low=limits[:, 0],
        high=limits[:, 1],
        weight=float(weight),
    )


class _Rounds:
    """Simulations of all cases at some constants, which are done once each."""

    def __init__(self, client: Client, cases: Sequence[FitCase], progress: Progress) -> None:
        self.cases, self.left_out = list(cases), dict[str, str]()
        self._client, self._progress = client, progress
        self._known: dict[bytes, dict[str, CaseFit]] = {}

    def __call__(self, counted: np.ndarray) -> Mapping[str, Piece]:
        """The pieces of all patients."""
        fits = self.at(counted)
        pieces: dict[str, list[Piece]] = {}
        for case in self.cases:
            one = fits[case.name]
            assert one.derivative is not None  # it was asked for
            pieces.setdefault(case.patient, []).append((one.residuals, one.derivative))
        return {
            patient: (np.concatenate([r for r, _ in own]), np.concatenate([j for _, j in own]))
            for patient, own in pieces.items()
        }

    def at(self, counted: np.ndarray) -> dict[str, CaseFit]:
        """Every case at some constants; those that cannot be simulated at the first are left out from then on."""
        key = counted.tobytes()
        if key not in self._known:
            self._known[key] = self._round(counted)
        return self._known[key]

    def _round(self, counted: np.ndarray) -> dict[str, CaseFit]:
        results = self.submitted([(case, case.job, counted) for case in self.cases])
        failed = {name: str(error) for name, error in results.items() if isinstance(error, Exception)}
        if failed and self._known:
            return {name: one if isinstance(one, CaseFit) else self._worse(name) for name, one in results.items()}
        self.left_out |= failed
        self.cases = [case for case in self.cases if case.name not in failed]
        if not self.cases:
            raise InputError(f"calibrate: no case could be simulated; the first: {next(iter(failed.values()))}")
        return {name: one for name, one in results.items() if isinstance(one, CaseFit)}

    def _worse(self, name: str) -> CaseFit:
        """A fit so much worse than the last one of a case that the search takes a shorter step from there."""
        last = next(reversed(self._known.values()))[name]
        return dataclasses.replace(last, residuals=WORSE * last.residuals)

    def submitted(self, jobs: Sequence[tuple[FitCase, FitJob, np.ndarray]]) -> dict[str, CaseFit | Exception]:
        """Jobs over the workers; what a job refuses is in its place."""
        from distributed import as_completed

        futures = {self._client.submit(tried, job, counted, pure=False): case.name for case, job, counted in jobs}
        found: dict[str, CaseFit | Exception] = {}
        self._progress.part("cases of this round", 0, len(futures))
        for future in as_completed(list(futures)):
            try:
                found[futures[future]] = future.result()
            except Exception as error:  # its worker's; the round tells
                found[futures[future]] = error
            one = found[futures[future]]
            said = str(one) if isinstance(one, Exception) else f"{one.skin_mm:.2f} mm from the actual back"
            self._progress.part("cases of this round", len(found), len(futures), f"{futures[future]}: {said}")
        return found


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


def _held_out(rounds: _Rounds, fit: Fit, prior: Prior, free: Sequence[FreeConstant]) -> tuple[HeldOut, ...]:
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
