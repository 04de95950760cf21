"""A calibration: constants that fit the actual skins of several patients best, judged on each patient left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.run.progress import Progress

from ..statistics import PatientMean, over_patients
from .fit import Fit, Piece, Prior, certainty, find, without
from .free_constants import FreeConstant, values_of
from .one_fit import CaseFit, FitJob, fit_case

if TYPE_CHECKING:
    from distributed import Client


@dataclass(frozen=True, kw_only=True)
class FittedConstant:
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

    constants: tuple[FittedConstant, ...]
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
    held_out_gain_mm: PatientMean | None
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
    constants = [
        FittedConstant(
            name=constant.name,
            start=constant.start,
            value=constant.value(float(x)),
            low=constant.value(max(float(x - sure.width * sd), constant.limits[0])),
            high=constant.value(min(float(x + sure.width * sd), constant.limits[1])),
            from_data=float(share),
        )
        for constant, x, sd, share in zip(free, fit.counted, sure.sd, sure.from_data, strict=True)
    ]
    held_out: list[HeldOut] = []
    if len(fit.pieces) > 1:  # every case with the constants of the other patients, simulated
        left_out = {patient: without(fit.pieces, patient, fit.counted, prior) for patient in fit.pieces}
        left = rounds.submitted([(replace(job, derivative=False), left_out[job.patient]) for job in cases])
        held_out = [
            HeldOut(
                case=job.name,
                patient=job.patient,
                constants=values_of(free, left_out[job.patient]),
                skin_before_mm=first[job.name].skin_mm,
                skin_mm=fit_of_case.skin_mm,
                bsr_before_deg=first[job.name].bsr_deg,
                bsr_deg=fit_of_case.bsr_deg,
            )
            for job in cases
            if isinstance(fit_of_case := left[job.name], CaseFit)
        ]
    gains = [case_fit.skin_before_mm - case_fit.skin_mm for case_fit in held_out]
    return Calibration(
        constants=tuple(constants),
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
        held_out_gain_mm=over_patients(gains, [case_fit.patient for case_fit in held_out]),
    )


def prior_of(free: Sequence[FreeConstant], weight: bool) -> Prior:
    """The prior of the constants; without priors only their limits."""
    low, high = np.array([constant.limits for constant in free]).T
    mean, sd = np.array([(constant.counted(constant.start), constant.believed) for constant in free]).T
    return Prior(mean=mean, sd=sd, low=low, high=high, weight=float(weight))


WORSE = 3.0
"""How much larger residuals are taken to be at constants with which a case finds no equilibrium."""
MOST_LOST = 0.25
"""Where more than this part of the cases finds none, a step was too long; fewer are at the edge of what the model
can do wherever the search goes, and are left out."""


class _LostError(Exception):
    """Cases were left out in the middle of a search."""


class Rounds:
    """Simulations of all cases at some constants, which are done once each."""

    def __init__(self, client: Client, jobs: Sequence[FitJob], progress: Progress) -> None:
        self.jobs, self.left_out = list(jobs), dict[str, str]()
        self._client, self._progress = client, progress
        self._rounds: dict[bytes, dict[str, CaseFit]] = {}
        self._where: dict[str, list[str]] = {}

    @property
    def count(self) -> int:
        """How many there were."""
        return len(self._rounds)

    def search(self, prior: Prior) -> Fit:
        """The constants that fit best all cases that find an equilibrium wherever the search goes."""
        while True:
            try:
                return find(self, prior)
            except _LostError:
                continue  # from the start, whose round is known

    def __call__(self, counted: np.ndarray) -> Mapping[str, Piece]:
        """The pieces of all patients."""
        fits = self.at(counted)
        pieces: dict[str, list[Piece]] = {}
        for job in self.jobs:
            case_fit = fits[job.name]
            assert case_fit.derivative is not None  # it was asked for
            pieces.setdefault(job.patient, []).append((case_fit.residuals, case_fit.derivative))
        return {
            patient: (np.concatenate([r for r, _ in own]), np.concatenate([j for _, j in own]))
            for patient, own in pieces.items()
        }

    def at(self, counted: np.ndarray) -> dict[str, CaseFit]:
        """Every case at some constants.

        Raises:
            _LostError: some found no equilibrium, and are left out from now on.
        """
        key = counted.tobytes()
        if key not in self._rounds:
            results = self.submitted([(job, counted) for job in self.jobs])
            failed = {name: str(error) for name, error in results.items() if isinstance(error, Exception)}
            begun = bool(self._rounds)
            if begun and len(failed) > MOST_LOST * len(self.jobs):
                results |= {name: self._worse(name) for name in failed}
                failed = {}
            self._rounds[key] = {name: result for name, result in results.items() if isinstance(result, CaseFit)}
            self.left_out |= failed
            self.jobs = [job for job in self.jobs if job.name not in failed]
            if not self.jobs:
                first = next(iter(failed.values()))
                raise InputError(f"calibrate: no case could be simulated; the first: {first}")
            if begun and failed:
                raise _LostError
        return self._rounds[key]

    def _worse(self, name: str) -> CaseFit:
        """A fit so much worse than the last one of a case that the search takes a shorter step from there."""
        last = next(fits[name] for fits in reversed(self._rounds.values()) if name in fits)
        return replace(last, residuals=WORSE * last.residuals)

    def submitted(self, jobs: Sequence[tuple[FitJob, np.ndarray]]) -> dict[str, CaseFit | Exception]:
        """Jobs over the workers, best where a case was done before; what a job refuses is in its place."""
        from distributed import as_completed

        where, doing = self._where, "cases of this round"
        futures = {}
        for job, counted in jobs:
            before: Any = {"workers": where.get(job.name), "allow_other_workers": job.name in where}
            futures[self._client.submit(fit_case, job, counted, pure=False, **before)] = job.name
        results: dict[str, CaseFit | Exception] = {}
        self._progress.part(doing, 0, len(futures))
        for future in as_completed(list(futures)):
            name = futures[future]
            try:
                ended = results[name] = future.result()
            except Exception as error:  # of the case or its worker; the round reports it
                ended = results[name] = error
            how = str(ended) if isinstance(ended, Exception) else f"{ended.skin_mm:.2f} mm from the actual back"
            self._progress.part(doing, len(results), len(futures), f"{name}: {how}")
        done: Any = self._client.who_has(list(futures))  # of a client that is not asynchronous
        self._where |= {name: list(done[future.key]) for future, name in futures.items() if done.get(future.key)}
        return results
