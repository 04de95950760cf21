"""Which cases a search goes on with, on cases whose residuals are known: the constant less 3, each with a limit
beyond which it finds no equilibrium."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from warp_trunk.cohort.calibration.calibrate import Rounds
from warp_trunk.cohort.calibration.fit import Prior
from warp_trunk.cohort.calibration.free_constants import FreeConstant
from warp_trunk.cohort.calibration.one_fit import CaseFit, FitJob
from warp_trunk.errors import InputError
from warp_trunk.run.options import RunOptions
from warp_trunk.run.progress import Progress

PRIOR = Prior(mean=np.zeros(1), sd=np.ones(1), low=np.full(1, -9.0), high=np.full(1, 9.0), weight=0.0)
ALWAYS = 99.0


class Known(Rounds):
    """Rounds that need no workers."""

    def __init__(self, limits: Mapping[str, float]) -> None:
        self.limits = limits
        free = (FreeConstant(name="theta", start=1.0),)
        nobody: Any = None
        jobs = [FitJob(folder=Path(name), options=RunOptions(), align_pelvis=False, free=free) for name in limits]
        super().__init__(nobody, jobs, Progress())

    def submitted(self, jobs: Sequence[tuple[FitJob, np.ndarray]]) -> dict[str, CaseFit | Exception]:
        """Each case at its constants."""
        return {job.name: self.one(job.name, float(counted[0])) for job, counted in jobs}

    def one(self, name: str, x: float) -> CaseFit | Exception:
        """A case at a constant."""
        if x > self.limits[name]:
            return InputError(f"{name}: ended STALLED")
        residuals = np.array([np.exp(0.1 * x) - np.exp(0.3)])
        derivative = np.array([[0.1 * np.exp(0.1 * x)]])
        return CaseFit(residuals=residuals, derivative=derivative, skin_mm=1.0, bsr_deg=None)


def test_a_few_cases_that_end_so_on_the_way_are_left_out_and_told() -> None:
    rounds = Known({"a": ALWAYS, "b": ALWAYS, "c": ALWAYS, "edge": 1.0})
    fit = rounds.search(PRIOR)
    assert fit.converged
    assert fit.counted[0] == pytest.approx(3.0, abs=1e-2)
    assert [job.name for job in rounds.jobs] == list("abc")
    assert rounds.left_out == {"edge": "edge: ended STALLED"}
    assert rounds.count >= 3  # the start is not simulated again, and counted once


def test_where_many_end_so_the_step_is_shorter_and_nobody_is_left_out() -> None:
    rounds = Known({"a": ALWAYS, "b": 3.1, "c": 3.1, "d": 3.1})  # the first step leads to 3.5
    fit = rounds.search(PRIOR)
    assert fit.counted[0] == pytest.approx(3.0, abs=1e-2)
    assert rounds.left_out == {}


def test_what_fails_at_the_start_takes_no_part() -> None:
    rounds = Known({"a": ALWAYS, "never": -1.0})
    rounds.search(PRIOR)
    assert list(rounds.left_out) == ["never"]
    with pytest.raises(InputError, match="no case could be simulated; the first: never"):
        Known({"never": -1.0}).search(PRIOR)
