"""A calibration over patients: its search, file and page, and what the command refuses."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.cohort_cases import turned_case
from support.small_case import small_case
from warp_trunk.case import write_case
from warp_trunk.case.case import Study
from warp_trunk.case.tissue_file import read_tissue_file
from warp_trunk.cohort.calibration.calibrate import Calibration, Found, HeldOut, Rounds, prior_of
from warp_trunk.cohort.calibration.fit import Prior
from warp_trunk.cohort.calibration.free_constants import FreeConstant
from warp_trunk.cohort.calibration.one_fit import CaseFit, FitJob
from warp_trunk.cohort.calibration.report import calibration_text, write_calibration
from warp_trunk.cohort.statistics import over_patients
from warp_trunk.errors import InputError
from warp_trunk.run.options import RunOptions
from warp_trunk.run.progress import Progress

CALIBRATION = Calibration(
    found=(
        Found(name="poisson_ratio", start=0.45, value=0.468, low=0.455, high=0.48, from_data=0.9),
        Found(name="fat.youngs_modulus", start=2.5, value=2.9, low=1.5, high=5.5, from_data=0.2),
    ),
    correlation=((1.0, -0.4), (-0.4, 1.0)),
    cases=("a", "b", "c"),
    patients=3,
    poses=("surgery",),
    synthetic=3,
    left_out={"d": "ended STALLED <here>"},
    rounds=4,
    converged=True,
    skin_before_mm=2.5,
    skin_mm=1.5,
    held_out=tuple(
        HeldOut(
            case=name, patient=name, constants={}, skin_before_mm=2.5, skin_mm=mm, bsr_before_deg=2.0, bsr_deg=None
        )
        for name, mm in zip("abc", (1.0, 1.5, 2.0), strict=True)
    ),
    held_out_gain_mm=over_patients([1.5, 1.0, 0.5], list("abc")),
)  # fmt: skip


def test_file_and_page(tmp_path: Path) -> None:
    page = write_calibration(tmp_path / "tissue.toml", CALIBRATION).read_text()
    assert read_tissue_file(tmp_path / "tissue.toml") == {"poisson_ratio": 0.468, "fat.youngs_modulus": 2.9}
    assert "SYNTHETIC" in (tmp_path / "tissue.toml").read_text()
    assert json.loads((tmp_path / "tissue.json").read_text())["found"][0]["low"] == 0.455
    for said in (
        "0.455 to 0.48",
        "+0.50 to +1.50 mm, drawn over 3 patients",
    ):
        assert said in page, said
    assert "2.50 mm before, 1.50 after" in calibration_text(CALIBRATION)


def test_what_is_believed_is_that_of_bands() -> None:
    free = [
        FreeConstant(name="fat.youngs_modulus", start=2.5),
        FreeConstant(name="ribs.reversible_part", start=0.8),
    ]
    prior = prior_of(free, True)
    assert prior.mean == pytest.approx([np.log(2.5), 0.8])
    assert prior.sd == pytest.approx([np.log(1.6), 0.15])  # 0.7 to 1.0
    assert (prior.low[1], prior.high[1]) == (0.0, 1.0)
    assert (prior_of(free, False).information == 0.0).all()


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("to calibrate")
    write_case(folder / "a", turned_case("a", 1.0, Study(patient="P1", synthetic=True)))
    write_case(folder / "b", small_case())
    return folder


@pytest.mark.parametrize(
    ("command", "options", "said"),
    [
        ("calibrate", "--free poisson_ratio --pose bending", "no case with a spine and an actual skin after bend"),
        ("calibrate", "--free poisson_ratio --out tissue.txt", "tissue.txt: must end in .toml"),
        ("cohort", "--live", "--live: is for one case"),
        ("cohort", "--theta 3 --energy neo-hookean", "--theta: used by --energy itmsm"),
        ("cohort", "--tissue-file nowhere.toml", "nowhere.toml: there is no such file"),
    ],
)
def test_refused(cases, command, options, said, tmp_path, refused):
    out = [] if "--out" in options else ["--out", tmp_path / "tissue.toml"]
    refused([command, cases, *options.split(), *out], said)


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
