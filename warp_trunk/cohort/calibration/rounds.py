"""Rounds of a calibration: all cases simulated at the same constants, each where it is known already."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from warp_trunk.errors import InputError

from .fit import Fit, Piece, Prior, find
from .one_fit import CaseFit, FitJob, tried

if TYPE_CHECKING:
    from distributed import Client

    from warp_trunk.run.progress import Progress

WORSE = 3.0
"""How much larger residuals are taken to be at constants with which a case finds no equilibrium."""
MOST_LOST = 0.25
"""Where more than this part of the cases finds none, a step was too long; fewer are at the edge of what the model
can do wherever the search goes, and are left out."""


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
    """The task of a worker."""


class _LostError(Exception):
    """Cases were left out in the middle of a search."""


class Rounds:
    """Simulations of all cases at some constants, which are done once each."""

    def __init__(self, client: Client, cases: Sequence[FitCase], progress: Progress) -> None:
        self.cases, self.left_out = list(cases), dict[str, str]()
        self._client, self._progress = client, progress
        self._known: dict[bytes, dict[str, CaseFit]] = {}
        self._where: dict[str, list[str]] = {}

    @property
    def count(self) -> int:
        """How many there were."""
        return len(self._known)

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
        for case in self.cases:
            one = fits[case.name]
            assert one.derivative is not None  # it was asked for
            pieces.setdefault(case.patient, []).append((one.residuals, one.derivative))
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
        if key not in self._known:
            results = self.submitted([(case, case.job, counted) for case in self.cases])
            failed = {name: str(error) for name, error in results.items() if isinstance(error, Exception)}
            begun = bool(self._known)
            if begun and len(failed) > MOST_LOST * len(self.cases):
                results |= {name: self._worse(name) for name in failed}
                failed = {}
            self._known[key] = {name: one for name, one in results.items() if isinstance(one, CaseFit)}
            self._leave_out(failed)
            if begun and failed:
                raise _LostError
        return self._known[key]

    def _leave_out(self, failed: Mapping[str, str]) -> None:
        self.left_out |= failed
        self.cases = [case for case in self.cases if case.name not in failed]
        if not self.cases:
            raise InputError(f"calibrate: no case could be simulated; the first: {next(iter(failed.values()))}")

    def _worse(self, name: str) -> CaseFit:
        """A fit so much worse than the last one of a case that the search takes a shorter step from there."""
        last = next(fits[name] for fits in reversed(self._known.values()) if name in fits)
        return dataclasses.replace(last, residuals=WORSE * last.residuals)

    def submitted(self, jobs: Sequence[tuple[FitCase, FitJob, np.ndarray]]) -> dict[str, CaseFit | Exception]:
        """Jobs over the workers, best where a case was done before; what a job refuses is in its place."""
        from distributed import as_completed

        futures = {
            self._client.submit(
                tried,
                job,
                counted,
                pure=False,
                workers=self._where.get(case.name),
                allow_other_workers=case.name in self._where,
            ): case.name
            for case, job, counted in jobs
        }
        found: dict[str, CaseFit | Exception] = {}
        self._progress.part("cases of this round", 0, len(futures))
        for future in as_completed(list(futures)):
            try:
                found[futures[future]] = future.result()
            except Exception as error:  # of its worker; the round reports it
                found[futures[future]] = error
            one = found[futures[future]]
            said = str(one) if isinstance(one, Exception) else f"{one.skin_mm:.2f} mm from the actual back"
            self._progress.part("cases of this round", len(found), len(futures), f"{futures[future]}: {said}")
        done: Any = self._client.who_has(list(futures))  # of a client that is not asynchronous
        self._where |= {name: list(done[one.key]) for one, name in futures.items() if done.get(one.key)}
        return found
