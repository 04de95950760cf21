"""Warnings on the console, in the summary and in the report."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from support.asserting import refuses
from support.known_spine import before_and_after, known_spine
from support.shown import check_shown
from support.small_trunk import boned_case, made_up_increments, small_case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.measures.quantities import Measured, MeasureTable
from warp_trunk.meshing import MeshOptions
from warp_trunk.run import simulate as running
from warp_trunk.run import warnings
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.patient import patient_of
from warp_trunk.run.progress import Progress
from warp_trunk.run.simulate import simulate
from warp_trunk.run.warnings import (
    alignment_warnings,
    curve_warnings,
    ending_warnings,
    endplate_warnings,
    flexibility_warnings,
    option_warnings,
)

LAST = made_up_increments(small_case()[1])[-1].relaxation
STALLED, INVERTED = replace(LAST, status=RelaxStatus.STALLED), replace(LAST, inverted_tets=3)
LIMIT = replace(LAST, status=RelaxStatus.STEP_LIMIT)
ENDINGS = {
    "none": (LAST, [], []),
    "stalled": (STALLED, [], []),
    "inverted": (INVERTED, [], []),
    "one inverted": (replace(LAST, inverted_tets=1), [], []),
    "inverted at the step limit": (replace(INVERTED, status=RelaxStatus.STEP_LIMIT), [], []),
    "bones collide": (STALLED, ["bones collide at T8 and T9"], ["the spline folds"]),
    "the spline folds": (INVERTED, [], ["the spline folds around T8"]),
    "along the gradient": (replace(LAST, status=RelaxStatus.STOPPED, estimated_error=21.7), [], []),
    "all steps": (LIMIT, [], []),
}  # fmt: skip
NUMBERS: dict[str, tuple[str, str, tuple[float, ...]]] = {
    "trunk_shift_mm": ("", "predicted", (-20.4, -19.9, 20.0, 20.1)),
    "kyphosis_deg": ("T5-T12", "predicted", (-3.0, 9.9, 10.0, 40.0, 40.6)),
    "shoulder_difference_mm": ("", "6", (-7.0, -4.9, 7.0)),
    "apical_translation_mm": ("T9", "45", (-6.0, -4.9, 6.0)),
}
"""Level, the number before in the unit of the quantity, and several numbers predicted."""


def spine(share: float) -> Landmarks:
    tilts = {"T1": 28.0, "T5": 30.0, "T12": -30.0, "L5": -28.0}
    return known_spine(to_left={level: share * tilt for level, tilt in tilts.items()})


def warnings_of_all() -> Iterator[str]:
    for name, ending in ENDINGS.items():
        yield f"{name}: {ending_warnings(*ending)}"
    for quantity, (level, was, numbers) in NUMBERS.items():
        for will in numbers:
            rows = [Measured("predicted", level, quantity, will)]
            rows += [] if was == "predicted" else [Measured("before", level, quantity, float(was))]
            yield f"{quantity} {will}: {alignment_warnings(MeasureTable(rows))}"
    before, after = before_and_after()
    bent = replace(after, points=after.points * [2.0, 1.0, 1.0])
    for pose in ("surgery", "bending"):
        yield f"larger, after {pose}: {curve_warnings(before, bent, pose)}"
    yield f"smaller and the same: {curve_warnings(bent, before) + curve_warnings(before, before)}"
    random = np.random.default_rng(2)
    rough = replace(before, points=before.points + random.normal(0.0, 1.5, before.points.shape))
    for name, marks in (("smooth", (before, before)), ("rough", (rough, before)), ("both", (rough, rough))):
        yield f"endplates {name}: {endplate_warnings(*marks)}"
    for corrected in (
        0.4,
        0.55,
        0.8,
    ):  # the curve of 60 degrees bends out to a half, and 5 degrees are not measured
        films = {"bending_left": spine(0.5), "bending_right": spine(1.0)}
        case = replace(small_case()[0], landmarks_before=spine(1.0), landmarks_after=spine(1.0 - corrected))
        bent_out = flexibility_warnings(replace(case, **films))
        yield f"corrected by {corrected}: {bent_out + flexibility_warnings(case)}"
    for tissue, gravity in (
        (Tissue(), 0.0),
        (Tissue(youngs_modulus=130.0, density=1090.0), 9.81),
        (Tissue(density=1.0, youngs_modulus=501.0), 981.0),
    ):
        yield f"{tissue.density} {gravity}: {option_warnings([tissue, tissue], gravity)}"


def test_what_is_warned_of_and_what_is_not_is_as_accepted() -> None:
    check_shown("warnings", warnings_of_all())


def test_a_case_made_in_code_is_checked_like_one_that_is_read(tmp_path):
    case, _ = small_case()
    nowhere = replace(case.landmarks_before, points=np.zeros_like(case.landmarks_before.points))
    with pytest.raises(InputError, match="landmarks_before: landmarks must not lie in one plane"):
        simulate(replace(case, landmarks_before=nowhere), folder=tmp_path / "out")


def test_more_than_the_memory_is_refused_before_any_work_unless_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    case, options = boned_case()[0], RunOptions(mesh=MeshOptions(tets=5_000_000))
    asked: Any = {"options": options, "warnings": (), "progress": Progress()}
    monkeypatch.setattr(warnings, "usable_memory", lambda: 4.5e9)

    def prepare(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "prepare", prepare)
    cost = "5000000 tetrahedra need about 5.5 GB of memory and 29 min on two cores"
    with refuses("this machine has 4.5 GB; ask for 4000000, or give --yes", begins=f"tets: {cost}"):
        simulate(case, **asked)
    with pytest.raises(KeyboardInterrupt):  # it goes on
        simulate(case, **asked, execution=Execution(yes=True, record=False))
    assert capsys.readouterr().err == f"{cost}\n"


def test_the_usual_number_says_nothing(monkeypatch):
    assert warnings.check_memory(225_000) is None
    monkeypatch.setattr(warnings, "usable_memory", lambda: 0.7e9)
    with pytest.raises(InputError, match="ask for 200000"):
        warnings.check_memory(225_000)


def test_a_patient_is_refused_with_a_constant_that_her_model_does_not_read() -> None:
    with pytest.raises(InputError, match="--poisson-ratio: used by --energy neo-hookean"):
        patient_of(small_case()[0], RunOptions(energy="itmsm", constants={"poisson_ratio": 0.4}))
