"""One case of a calibration: its derivatives are differences of whole simulations."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from support.asserting import there
from support.cohort_cases import cohort_options, turned_case
from warp_trunk.case import write_case
from warp_trunk.case.tissue_file import constant_of
from warp_trunk.cohort.calibration.free_constants import FreeConstant
from warp_trunk.cohort.calibration.one_fit import FitJob, fit_case
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.errors import InputError

FREE = ("poisson_ratio", "fat.youngs_modulus", "ribs.reversible_part", "ribs.axial_rotation")


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> FitJob:
    return made_job(tmp_path_factory, FREE)


def made_job(tmp_path_factory: pytest.TempPathFactory, names: tuple[str, ...], **changed: Any) -> FitJob:
    """A case in which T7 turns, and these constants free."""
    folder = tmp_path_factory.mktemp("fit") / "case"
    case = turned_case("fit", 2.0)
    marks = case.planned_landmarks
    turned = marks.points.copy()
    rows = [row for row, name in enumerate(marks.names) if name.startswith("T7")]
    middle = turned[rows].mean(axis=0)
    c, s = np.cos(0.3), np.sin(0.3)
    turned[rows] = (turned[rows] - middle) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + middle
    write_case(folder, replace(case, landmarks_after=replace(marks, points=turned)))
    options = replace(
        cohort_options(threads=1).run,
        energy="neo-hookean",
        layers="depth",
        bones="follow",
        precision="float64",
        simulation=SimulationOptions(increments=2, relax=RelaxOptions(tolerance=1e-6)),
        **changed,
    )
    free = tuple(FreeConstant(name=name, start=constant_of(case, name)) for name in names)
    return FitJob(folder=folder, options=options, align_pelvis=False, free=free)


def test_derivatives_are_differences(job: FitJob) -> None:
    check_derivatives(job)


def test_under_gravity_constants_move_the_rest_state_too(tmp_path_factory: pytest.TempPathFactory) -> None:
    check_derivatives(made_job(tmp_path_factory, ("fat.youngs_modulus",), gravity=9.81))


def check_derivatives(job: FitJob) -> None:
    start = np.array([one.counted(one.start) for one in job.free])
    derivative = there(fit_case(job, start).derivative)
    plain = replace(job, derivative=False)
    for number, free in enumerate(job.free):
        step = np.zeros(len(start))
        step[number] = 0.05 * free.believed  # distances are float32
        higher, lower = (fit_case(plain, start + way * step).residuals for way in (1.0, -1.0))
        difference = (higher - lower) / (2.0 * step[number])
        size = np.linalg.norm(difference)
        assert size > 1e-2, free.name
        # of all places together: where the nearest point changes its triangle, a difference sees both
        assert np.linalg.norm(derivative[:, number] - difference) < 0.02 * size, free.name


def relaxed(job: FitJob, relax: RelaxOptions) -> FitJob:
    return replace(job, options=replace(job.options, simulation=SimulationOptions(increments=2, relax=relax)))


def test_a_skin_that_is_settled_counts_though_no_equilibrium_is_confirmed(job: FitJob) -> None:
    start = np.array([one.counted(one.start) for one in job.free])
    unreached = relaxed(job, RelaxOptions(tolerance=1e-15, max_steps=12))
    found, wanted = fit_case(unreached, start), fit_case(job, start)
    np.testing.assert_allclose(found.residuals, wanted.residuals, atol=1e-4)
    slope, known = there(found.derivative), there(wanted.derivative)
    np.testing.assert_allclose(slope, known, atol=1e-2 * np.abs(known).max())


def test_a_skin_on_its_way_does_not_count(job: FitJob) -> None:
    with pytest.raises(InputError, match=r"ended STEP_LIMIT, the skin \d+\.\d mm from equilibrium"):
        fit_case(
            relaxed(job, RelaxOptions(method="gradient", max_steps=1)),
            np.array([one.counted(one.start) for one in job.free]),
        )
