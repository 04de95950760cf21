"""A calibration over patients: its constants, one case, least squares with priors, and what is refused."""

import json
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.asserting import not_none, refuses
from support.cohort_cases import cohort_options, turned_case
from support.drawn import Page
from support.shown import check_shown, page_lines, record_lines
from support.small_case import small_case
from warp_trunk.case import write_case
from warp_trunk.case.case import Study
from warp_trunk.case.tissue_file import constant_of, read_tissue_file
from warp_trunk.cli.cohort import Calibrate
from warp_trunk.cohort.calibration import calibrate as calibrating
from warp_trunk.cohort.calibration.calibrate import Calibration, FittedConstant, HeldOut, Rounds, prior_of
from warp_trunk.cohort.calibration.fit import Prior, certainty, find, without
from warp_trunk.cohort.calibration.free_constants import FreeConstant, check_free, values_of
from warp_trunk.cohort.calibration.one_fit import CaseFit, FitJob, fit_case
from warp_trunk.cohort.calibration.report import calibration_text, write_calibration
from warp_trunk.cohort.one_case import CohortOptions
from warp_trunk.cohort.statistics import over_patients
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import vertex_normals
from warp_trunk.io.atomic_write import json_text
from warp_trunk.run.options import RunOptions
from warp_trunk.run.progress import Progress

CALIBRATION = Calibration(
    constants=(
        FittedConstant(name="poisson_ratio", start=0.45, value=0.468, low=0.455, high=0.48, from_data=0.9),
        FittedConstant(name="fat.youngs_modulus", start=2.5, value=2.9, low=1.5, high=5.5, from_data=0.2),
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


FURTHER = replace(
    CALIBRATION, left_out={}, synthetic=0, held_out=CALIBRATION.held_out[:2],
    held_out_gain_mm=over_patients([-0.5, -0.3], ["a", "b"]),
)  # fmt: skip
OF_ONE = replace(
    CALIBRATION, constants=CALIBRATION.constants[:1], correlation=((1.0,),), cases=("a", "b"), patients=1,
    poses=("bending", "surgery"), converged=False, held_out=(), held_out_gain_mm=None,
)  # fmt: skip


@pytest.mark.parametrize(
    ("name", "calibration"),
    [("calibration", CALIBRATION), ("calibration_further", FURTHER), ("calibration_of_one", OF_ONE)],
)
def test_the_files_the_page_and_the_console_are_as_accepted(
    name: str, calibration: Calibration, tmp_path: Path
) -> None:
    """Of three patients, one of whose constants stays with its prior; of two who came no nearer; and of one."""
    page = Page(write_calibration(tmp_path / "tissue.toml", calibration).read_text(encoding="utf-8"))
    files = {ending: (tmp_path / f"tissue.{ending}").read_text(encoding="utf-8") for ending in ("toml", "json")}
    record = record_lines(json.loads(files["json"]), "record")
    check_shown(name, [*page_lines(page), calibration_text(calibration), files["toml"], *record])
    constants = {constant.name: constant.value for constant in calibration.constants}
    assert read_tissue_file(tmp_path / "tissue.toml") == constants


def test_what_is_believed_is_that_of_bands() -> None:
    free = [
        FreeConstant(name="fat.youngs_modulus", start=2.5),
        FreeConstant(name="ribs.reversible_part", start=0.8),
    ]
    prior = prior_of(free, True)
    assert prior.mean == pytest.approx([np.log(2.5), 0.8])
    assert prior.sd == pytest.approx([np.log(1.6), 0.15])  # 0.7 to 1.0
    assert prior.information == pytest.approx(np.diag(prior.sd**-2.0))
    assert (prior.low[0], prior.high[0]) == pytest.approx((np.log(2.5 / 1000.0), np.log(2.5 * 1000.0)))
    assert FreeConstant(name="poisson_ratio", start=0.4).limits == (0.0, 0.499)
    assert (prior.low[1], prior.high[1]) == (0.0, 1.0)
    assert (prior_of(free, False).information == 0.0).all()
    density = FreeConstant(name="density", start=1000.0)
    assert (density.believed, density.limits) == (50.0, (500.0, 2000.0))


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
        ("cohort", "--view", "--view: is for one case"),
        ("cohort", "--theta 3 --energy neo-hookean", "--theta: used by --energy itmsm"),
        ("cohort", "--tissue-file nowhere.toml", "nowhere.toml: there is no such file"),
    ],
)
def test_refused(cases, command, options, said, tmp_path, refused):
    out = [] if "--out" in options else ["--out", tmp_path / "tissue.toml"]
    refused([command, cases, *options.split(), *out], said)


def test_a_case_that_cannot_be_read_is_left_out_with_the_reason(cases, tmp_path, capsys):
    shutil.copytree(cases, tmp_path / "cases")
    write_case(tmp_path / "cases" / "0", turned_case("0", 1.0, Study(patient="P2", pose="bending")))
    (tmp_path / "cases" / "b" / "skin.ply").write_text("no surface", encoding="utf-8")
    command = Calibrate(
        folder=tmp_path / "cases", free=("poisson_ratio",), pose="surgery", out=tmp_path / "tissue.toml"
    )
    with Progress() as progress:
        jobs, broken = command._cases(command.of_each, progress)
    assert [job.name for job in jobs] == ["a"]
    assert list(broken) == ["b"]
    assert "skin.ply" in broken["b"]
    assert "is left out" in capsys.readouterr().err


PRIOR = Prior(mean=np.zeros(1), sd=np.ones(1), low=np.full(1, -9.0), high=np.full(1, 9.0), weight=0.0)
ALWAYS = 99.0


class ScriptedRounds(Rounds):
    """Rounds that need no workers."""

    def __init__(self, limits: Mapping[str, float]) -> None:
        self.limits = limits
        free = (FreeConstant(name="theta", start=1.0),)
        nobody: Any = None
        jobs = [FitJob(folder=Path(name), options=CohortOptions(), free=free) for name in limits]
        super().__init__(nobody, jobs, Progress())

    def submitted(self, jobs: Sequence[tuple[FitJob, np.ndarray]]) -> dict[str, CaseFit | Exception]:
        """Each case at its constants."""
        return {job.name: self.fit_of(job.name, float(counted[0])) for job, counted in jobs}

    def fit_of(self, name: str, x: float) -> CaseFit | Exception:
        """A case at a constant."""
        if x > self.limits[name]:
            return InputError(f"{name}: ended STALLED")
        residuals = np.array([np.exp(0.1 * x) - np.exp(0.3)])
        derivative = np.array([[0.1 * np.exp(0.1 * x)]])
        return CaseFit(residuals=residuals, derivative=derivative, skin_mm=1.0, bsr_deg=None)


def test_a_few_cases_that_end_so_on_the_way_are_left_out_and_told() -> None:
    rounds = ScriptedRounds({"a": ALWAYS, "b": ALWAYS, "c": ALWAYS, "edge": 1.0})
    fit = rounds.search(PRIOR)
    assert fit.converged
    assert fit.counted[0] == pytest.approx(3.0, abs=1e-2)
    assert [job.name for job in rounds.jobs] == list("abc")
    assert rounds.left_out == {"edge": "edge: ended STALLED"}
    assert rounds.count >= 3  # the start is not simulated again, and counted once


def test_where_many_end_so_the_step_is_shorter_and_nobody_is_left_out() -> None:
    rounds = ScriptedRounds({"a": ALWAYS, "b": 3.1, "c": 3.1, "d": 3.1})  # the first step leads to 3.5
    fit = rounds.search(PRIOR)
    assert fit.counted[0] == pytest.approx(3.0, abs=1e-2)
    assert rounds.left_out == {}


def test_what_fails_at_the_start_takes_no_part() -> None:
    rounds = ScriptedRounds({"a": ALWAYS, "never": -1.0})
    rounds.search(PRIOR)
    assert list(rounds.left_out) == ["never"]
    with pytest.raises(InputError, match="no case could be simulated; the first: never"):
        ScriptedRounds({"never": -1.0}).search(PRIOR)


def prior(*, weight: float = 1.0, mean: Sequence[float] = (0.0, 0.0), sd: Sequence[float] = (1.0, 2.0)) -> Prior:
    ends = np.full(len(mean), 9.0)
    return Prior(mean=np.array(mean), sd=np.array(sd), low=-ends, high=ends, weight=weight)


def linear(seed: int, patients: int, truth: np.ndarray, noise: float):
    """Patients whose residuals are linear in the constants, each with an error that her places share."""
    random = np.random.default_rng(seed)
    parts = {}
    for number in range(patients):
        J = random.standard_normal((30, len(truth)))
        parts[str(number)] = (J, J @ random.standard_normal(len(truth)) * noise)

    def evaluate(x: np.ndarray):
        return {name: (J @ (x - truth) + own, J) for name, (J, own) in parts.items()}

    return evaluate


def test_one_place_and_a_prior_by_hand():
    """Residual x - 3 with deviation 1, prior 0 ± 1: the middle, 1.5, variance 1 / 2, half of it from the place."""
    believed = prior(mean=(0.0,), sd=(1.0,))
    fitted = find(lambda x: {"a": (np.array([x[0] - 3.0]), np.ones((1, 1)))}, believed)
    assert fitted.converged
    assert fitted.counted[0] == pytest.approx(1.5)
    sure = certainty(fitted.pieces, believed)
    assert sure.sd[0] == pytest.approx(np.sqrt(0.5))
    assert sure.from_data[0] == pytest.approx(0.5)
    assert sure.width == pytest.approx(1.96, abs=0.001)


def test_without_a_prior_the_truth_comes_back():
    truth = np.array([1.2, -0.7])
    fitted = find(linear(1, 5, truth, 0.0), prior(weight=0.0))
    assert fitted.counted == pytest.approx(truth, abs=1e-6)
    assert certainty(fitted.pieces, prior(weight=0.0)).from_data == pytest.approx([1.0, 1.0])


def test_where_nothing_is_known_a_shorter_step_is_taken():
    """Residual sinh(x) - 1 from 0.1, whose first step leads beyond 0.95: what is worse there is not lost."""

    def evaluate(x: np.ndarray):
        capped = np.minimum(x, 0.95)
        worse = 3.0 if x[0] > 0.95 else 1.0
        return {"a": (worse * (np.sinh(capped) - 1.0), np.cosh(capped)[:, None])}

    fitted = find(evaluate, prior(weight=0.0, mean=(0.1,), sd=(1.0,)))
    assert fitted.counted[0] == pytest.approx(np.arcsinh(1.0), abs=2e-3)


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Errors that all places of a patient share: intervals from places alone would hold it in a third of cases."""
    truth, inside, draws = np.array([0.5, -0.3]), 0, 150
    for seed in range(draws):
        believed = prior(weight=1e-6)
        fitted = find(linear(seed, 12, truth, 1.0), believed)
        sure = certainty(fitted.pieces, believed)
        inside += int((np.abs(fitted.counted - truth) <= sure.width * sure.sd).sum())
    assert 0.90 <= inside / (2 * draws) <= 0.99


def test_leaving_a_patient_out_is_the_fit_to_the_others():
    evaluate, believed = linear(4, 6, np.array([0.4, 0.9]), 0.5), prior()
    fitted = find(evaluate, believed)
    left_out = find(lambda x: {name: piece for name, piece in evaluate(x).items() if name != "2"}, believed)
    assert without(fitted.pieces, "2", fitted.counted, believed) == pytest.approx(left_out.counted, abs=1e-5)


def test_constants_that_only_act_together_are_correlated():
    J = np.ones((20, 2))
    sure = certainty({"a": (np.zeros(20), J)}, prior(sd=(1.0, 1.0)))
    assert sure.correlation[0, 1] < -0.9
    assert sure.from_data == pytest.approx([20.0 / 41.0] * 2)


PAPERS: dict[str, Any] = {"bones": "spline"}
CONTINUUM: dict[str, Any] = {"bones": "spline", "energy": "neo-hookean"}


@pytest.mark.parametrize(
    ("names", "options", "why"),
    [
        (("poison_ratio",), {}, "did you mean 'poisson_ratio'?"),
        (("youngs_modulus",), PAPERS, "all forces grow with it alike"),
        (("youngs_modulus",), CONTINUUM, "give --gravity 9.81, or free the ratio of layers"),
        (("epsilon",), {}, "simulated with neo-hookean; give --energy itmsm"),
        (("poisson_ratio",), PAPERS, "give --energy neo-hookean"),
        (("ribs.reversible_part",), PAPERS, "give --bones follow"),
        (("fat.youngs_modulus",), {}, "give --layers depth"),
        (
            ("skin.youngs_modulus", "fat.youngs_modulus", "muscle.youngs_modulus"),
            {"layers": "depth"},
            "only ratios of the layers' Young's moduli act; leave one out",
        ),
    ],
)
def test_what_no_skin_tells_is_refused(names: tuple[str, ...], options: dict[str, Any], why: str) -> None:
    with refuses(why):
        check_free(names, small_case(), RunOptions(**options))


def test_constants_that_move_the_skin_are_accepted() -> None:
    check_free(("epsilon", "theta"), small_case(), RunOptions(**PAPERS))
    check_free(("youngs_modulus", "density"), small_case(), RunOptions(gravity=9.81))
    check_free(
        ("ribs.axial_rotation", "poisson_ratio", "fat.youngs_modulus"), small_case(), RunOptions(layers="depth")
    )


@pytest.mark.parametrize("name", ["poisson_ratio", "fat.youngs_modulus", "theta", "density", "ribs.scapula"])
def test_counting_goes_there_and_back(name: str) -> None:
    start = constant_of(small_case(), name)
    free = FreeConstant(name=name, start=start)
    counted = free.counted(start)
    assert values_of([free], np.array([counted]))[name] == pytest.approx(start)
    low, high = free.limits
    assert low <= counted <= high
    step = 1e-6
    change = (free.value(counted + step) - free.value(counted - step)) / (2.0 * step)
    assert free.slope(start) == pytest.approx(change, rel=1e-6)
    assert free.believed > 0.0


FREE = ("poisson_ratio", "ribs.axial_rotation")


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
    run = replace(
        cohort_options().run,
        energy="neo-hookean",
        layers="depth",
        bones="follow",
        precision="float64",
        simulation=SimulationOptions(increments=2, relax=RelaxOptions(tolerance=1e-6)),
        **changed,
    )
    free = tuple(FreeConstant(name=name, start=constant_of(case, name)) for name in names)
    return FitJob(folder=folder, options=CohortOptions(run=run, execution=cohort_options().execution), free=free)


def test_derivatives_are_differences(job: FitJob) -> None:
    check_derivatives(job)


def test_under_gravity_constants_move_the_rest_state_too(tmp_path_factory: pytest.TempPathFactory) -> None:
    check_derivatives(made_job(tmp_path_factory, ("fat.youngs_modulus",), gravity=9.81))


def check_derivatives(job: FitJob) -> None:
    start = np.array([constant.counted(constant.start) for constant in job.free])
    derivative = not_none(fit_case(job, start).derivative)
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


def test_every_place_weighs_as_much_as_forty_independent_ones_do(tmp_path: Path) -> None:
    """Nothing moves, and the actual skin is 3 mm outside everywhere; an error of 2 mm is one."""
    case = turned_case("fit", 0.0)
    outside = case.skin.moved(case.skin.vertices + 3.0 * vertex_normals(case.skin))
    write_case(tmp_path / "case", replace(case, landmarks_after=case.landmarks_before, actual_skin=outside))
    free = (FreeConstant(name="poisson_ratio", start=0.35),)
    fitted = fit_case(FitJob(folder=tmp_path / "case", options=cohort_options(), free=free), np.array([0.35]))
    assert np.median(fitted.residuals) == pytest.approx(
        -3.0 / 2.0 * np.sqrt(40.0 / len(fitted.residuals)), rel=0.03
    )
    assert len(fitted.residuals) > 100
    assert fitted.skin_mm == pytest.approx(3.0, rel=0.1)


def relaxed(job: FitJob, relax: RelaxOptions) -> FitJob:
    run = replace(job.options.run, simulation=SimulationOptions(increments=2, relax=relax))
    return replace(job, options=CohortOptions(run=run, execution=cohort_options().execution))


def test_a_skin_that_is_settled_counts_though_no_equilibrium_is_confirmed(job: FitJob) -> None:
    start = np.array([constant.counted(constant.start) for constant in job.free])
    unreached = relaxed(job, RelaxOptions(tolerance=1e-15, max_steps=12))
    settled, wanted = fit_case(unreached, start), fit_case(job, start)
    np.testing.assert_allclose(settled.residuals, wanted.residuals, atol=1e-4)
    slope, exact_slope = not_none(settled.derivative), not_none(wanted.derivative)
    np.testing.assert_allclose(slope, exact_slope, atol=1e-2 * np.abs(exact_slope).max())


def test_a_skin_on_its_way_does_not_count(job: FitJob) -> None:
    with pytest.raises(InputError, match=r"ended STEP_LIMIT, the skin \d+\.\d mm from equilibrium"):
        fit_case(
            relaxed(job, RelaxOptions(method="gradient", max_steps=1)),
            np.array([constant.counted(constant.start) for constant in job.free]),
        )


class Nearer(ScriptedRounds):
    """Rounds of backs that are as far from the actual ones as their constant is from that of their patient."""

    def __init__(self, jobs: Sequence[FitJob]) -> None:
        super().__init__({})
        self.jobs, self.asked = list(jobs), list[tuple[str, float]]()

    def submitted(self, jobs: Sequence[tuple[FitJob, np.ndarray]]) -> dict[str, CaseFit | Exception]:
        self.asked += [(job.name, float(counted[0])) for job, counted in jobs]
        return {job.name: self.of(job, float(counted[0])) for job, counted in jobs}

    @staticmethod
    def of(job: FitJob, x: float) -> CaseFit:
        """Its residual is the distance of the constant from the one that is best for the patient."""
        best = {"P1": 1.0, "P2": 1.2}[job.patient]
        residuals, derivative = np.array([x - best]), np.array([[1.0]])
        away = abs(x - best)
        return CaseFit(residuals=residuals, derivative=derivative, skin_mm=away, bsr_deg=2.0 * away)


def test_a_calibration_of_three_cases_is_as_accepted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two cases of one patient, best at 1, and one of another, best at 1.2, from log(10) = 2.30.

    The best of all is the mean of cases, 1.067, whose exponential is 2.91. Each is judged with the constant of
    the other, 0.2 from her best; before it was 1.30 and 1.10.
    """
    free = (FreeConstant(name="theta", start=10.0),)
    studies = {
        "a": Study(patient="P1", synthetic=True),
        "b": Study(patient="P1", pose="bending"),
        "c": Study(patient="P2", synthetic=True),
    }
    jobs = [
        FitJob(folder=Path(name), options=CohortOptions(), free=free, study=study)
        for name, study in studies.items()
    ]
    rounds: list[Nearer] = []

    def of_jobs(_: Any, jobs: Sequence[FitJob], __: Any) -> Nearer:
        rounds.append(Nearer(jobs))
        return rounds[0]

    monkeypatch.setattr(calibrating, "Rounds", of_jobs)
    nobody: Any = None
    calibration = calibrating.calibrate(nobody, jobs, free, Progress(), priors=False)
    assert {round(x, 6) for _, x in rounds[0].asked[:3]} == {
        round(math.log(10.0), 6)
    }  # as it is counted, at the start
    check_shown("calibrated", record_lines(json.loads(json_text(calibration)), "calibration"))
