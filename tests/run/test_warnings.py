"""Warnings on the console, in the summary and in the report."""

from dataclasses import replace

import numpy as np
import pytest

from support.known_spine import before_and_after, known_spine
from support.small_trunk import made_up_increments, small_case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.measures.quantities import Measured, MeasureTable
from warp_trunk.run import warnings
from warp_trunk.run.options import RunOptions
from warp_trunk.run.patient import patient_of
from warp_trunk.run.simulate import simulate
from warp_trunk.run.warnings import (
    alignment_warnings,
    curve_warnings,
    ending_warnings,
    flexibility_warnings,
    option_warnings,
)

LAST = made_up_increments(small_case()[1])[-1].relaxation


def test_a_plan_that_enlarges_the_largest_curve_is_warned_of():
    before, after = before_and_after()
    assert curve_warnings(before, before) == []
    bent = replace(after, points=after.points * [2.0, 1.0, 1.0])
    (text,) = curve_warnings(before, bent)
    assert text.startswith("The largest curve of the spine grows, from 40 to ")
    assert curve_warnings(bent, before) == []
    assert curve_warnings(before, bent, "bending") == []


@pytest.mark.parametrize(
    ("rows", "begins"),
    [
        (
            [("predicted", "", "trunk_shift_mm", -20.4)],
            "Balance: the top of the spine ends 20 mm left of the sacrum",
        ),
        ([("predicted", "", "trunk_shift_mm", 19.6)], None),
        (
            [("before", "", "shoulder_difference_mm", 6.0), ("predicted", "", "shoulder_difference_mm", -7.0)],
            "Shoulders: the higher one changes, from 6.0 mm right to 7.0 mm left.",
        ),
        ([("before", "", "shoulder_difference_mm", 6.0), ("predicted", "", "shoulder_difference_mm", -4.0)], None),
        (
            [("before", "T9", "apical_translation_mm", 45.0), ("predicted", "T9", "apical_translation_mm", -6.0)],
            "Apex T9: goes across the midline, from 45 mm right to 6.0 mm left.",
        ),
        (
            [("before", "T9", "apical_translation_mm", 45.0), ("predicted", "T9", "apical_translation_mm", 6.0)],
            None,
        ),
        (
            [("predicted", "T5-T12", "kyphosis_deg", 9.0)],
            "Kyphosis T5 to T12: ends at 9 degrees, 10 to 40 is normal.",
        ),
        ([("predicted", "T5-T12", "kyphosis_deg", 41.0)], "Kyphosis T5 to T12: ends at 41 degrees"),
        ([("predicted", "T5-T12", "kyphosis_deg", 40.0)], None),
    ],
)
def test_an_alignment_that_a_surgeon_avoids_is_warned_of(rows, begins):
    sentences = alignment_warnings(MeasureTable(Measured(*row) for row in rows))
    assert len(sentences) == (begins is not None)
    assert all(text.startswith(begins) for text in sentences)


@pytest.mark.parametrize(("corrected", "warned"), [(0.4, False), (0.8, True)])
def test_a_correction_beyond_the_flexibility_of_bends_is_warned_of(corrected, warned):
    """The curve of 60 degrees bends out to a half; 5 degrees more are not measured otherwise."""

    def spine(share: float) -> Landmarks:
        tilts = {"T1": 28.0, "T5": 30.0, "T12": -30.0, "L5": -28.0}
        return known_spine(to_left={level: share * tilt for level, tilt in tilts.items()})

    case = replace(
        small_case()[0], landmarks_before=spine(1.0), landmarks_after=spine(1.0 - corrected),
        bending_left=spine(0.5), bending_right=spine(1.0),
    )  # fmt: skip
    sentences = flexibility_warnings(case)
    assert bool(sentences) == warned
    assert all(text.startswith("Curve T") and "on the films of side bending to" in text for text in sentences)
    assert flexibility_warnings(replace(case, bending_left=None, bending_right=None)) == []


@pytest.mark.parametrize(
    ("tissue", "gravity", "named"),
    [
        (Tissue(), 0.0, []),
        (Tissue(youngs_modulus=130.0, density=1090.0), 9.81, []),
        (Tissue(density=1.0), 981.0, ["'density' is 1 kg/m3", "gravity: is 981 m/s^2"]),
    ],
)
def test_constants_that_no_tissue_has_are_warned_of_once(tissue, gravity, named):
    warnings = option_warnings([tissue, tissue], gravity)
    assert len(warnings) == len(named)
    assert all(part in text for part, text in zip(named, warnings, strict=True))


@pytest.mark.parametrize("ending", [{"status": RelaxStatus.STALLED}, {"inverted_tets": 3}])
def test_an_end_that_the_bones_cause_is_not_blamed_on_precision(ending):
    last = replace(LAST, **ending)
    (text,) = ending_warnings(last, ["bones collide at T8 and T9"], ["the spline folds"])
    assert "bones collide at T8 and T9" in text
    assert "float64" not in text
    (text,) = ending_warnings(last, [], ["the spline folds around T8"])
    assert "the spline folds around T8" in text
    (text,) = ending_warnings(last, [], [])
    assert ("in float64 neither" in text) == (last.status is RelaxStatus.STALLED)


def test_a_relaxation_along_the_gradient_says_how_far_it_ended_and_what_reaches_the_equilibrium():
    (text,) = ending_warnings(replace(LAST, status=RelaxStatus.STOPPED, estimated_error=21.7), [], [])
    assert "about 22 mm away; use --method newton" in text
    (text,) = ending_warnings(replace(LAST, status=RelaxStatus.STEP_LIMIT), [], [])
    assert "--max-steps, or use --method newton" in text


def test_a_case_made_in_code_is_checked_like_one_that_is_read(tmp_path):
    case, _ = small_case()
    nowhere = replace(case.landmarks_before, points=np.zeros_like(case.landmarks_before.points))
    with pytest.raises(InputError, match="landmarks_before: landmarks must not lie in one plane"):
        simulate(replace(case, landmarks_before=nowhere), folder=tmp_path / "out")


def test_more_than_the_memory_is_refused_before_any_work(monkeypatch, refused, tmp_path):
    monkeypatch.setattr(warnings, "usable_memory", lambda: 4.5e9)
    refused(
        ["demo", "--tets", "5000000", "--out", tmp_path / "out"],
        "5000000 tetrahedra need about 5.5 GB of memory and 29 min",
        "this machine has 4.5 GB; ask for 4000000, or give --yes",
    )
    assert not (tmp_path / "out").exists()
    assert "5.5 GB" in (warnings.check_memory(5_000_000, go_on=True) or "")


def test_the_usual_number_says_nothing(monkeypatch):
    assert warnings.check_memory(225_000) is None
    monkeypatch.setattr(warnings, "usable_memory", lambda: 0.7e9)
    with pytest.raises(InputError, match="ask for 200000"):
        warnings.check_memory(225_000)


def test_memory_is_known_here():
    assert 1e8 < warnings.usable_memory() < 1e14


def test_a_patient_is_refused_with_a_constant_that_her_model_does_not_read() -> None:
    with pytest.raises(InputError, match="--poisson-ratio: used by --energy neo-hookean"):
        patient_of(small_case()[0], RunOptions(energy="itmsm", constants={"poisson_ratio": 0.4}))
