"""Rounds of a calibration: all cases simulated at the same constants, each where it is known already."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from warp_trunk.errors import InputError

from .fit import Fit, Piece, Prior, find
from .one_fit import CaseFit, FitJob, fit_case

if TYPE_CHECKING:
    from distributed import Client

    from warp_trunk.run.progress import Progress

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
        for job in self.jobs:
            one = fits[job.name]
            assert one.derivative is not None  # it was asked for
            pieces.setdefault(job.patient, []).append((one.residuals, one.derivative))
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
            results = self.submitted([(job, counted) for job in self.jobs])
            failed = {name: str(error) for name, error in results.items() if isinstance(error, Exception)}
            begun = bool(self._known)
            if begun and len(failed) > MOST_LOST * len(self.jobs):
                results |= {name: self._worse(name) for name in failed}
                failed = {}
            self._known[key] = {name: one for name, one in results.items() if isinstance(one, CaseFit)}
            self.left_out |= failed
            self.jobs = [job for job in self.jobs if job.name not in failed]
            if not self.jobs:
                first = next(iter(failed.values()))
                raise InputError(f"calibrate: no case could be simulated; the first: {first}")
            if begun and failed:
                raise _LostError
        return self._known[key]

    def _worse(self, name: str) -> CaseFit:
        """A fit so much worse than the last one of a case that the search takes a shorter step from there."""
        last = next(fits[name] for fits in reversed(self._known.values()) if name in fits)
        return replace(last, residuals=WORSE * last.residuals)

    def submitted(self, jobs: Sequence[tuple[FitJob, np.ndarray]]) -> dict[str, CaseFit | Exception]:
        """Jobs over the workers, best where a case was done before; what a job refuses is in its place."""
        from distributed import as_completed

        where, doing = self._where, "cases of this round"
        futures = {}
        for job, counted in jobs:
            before: Any = {"workers": where.get(job.name), "allow_other_workers": job.name in where}
            futures[self._client.submit(fit_case, job, counted, pure=False, **before)] = job.name
        found: dict[str, CaseFit | Exception] = {}
        self._progress.part(doing, 0, len(futures))
        for future in as_completed(list(futures)):
            name = futures[future]
            try:
                one = found[name] = future.result()
            except Exception as error:  # of the case or its worker; the round reports it
                one = found[name] = error
            ended = str(one) if isinstance(one, Exception) else f"{one.skin_mm:.2f} mm from the actual back"
            self._progress.part(doing, len(found), len(futures), f"{name}: {ended}")
        done: Any = self._client.who_has(list(futures))  # of a client that is not asynchronous
        self._where |= {name: list(done[one.key]) for one, name in futures.items() if done.get(one.key)}
        return found
