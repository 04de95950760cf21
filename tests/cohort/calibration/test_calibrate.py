"""A calibration over patients, its file and its page; what the command refuses."""

import json
from pathlib import Path

import numpy as np
import pytest

from support.cohort_cases import turned_case
from support.small_case import small_case
from warp_trunk.case import write_case
from warp_trunk.case.case import Study
from warp_trunk.case.tissue_file import read_tissue_file
from warp_trunk.cohort.calibration.calibrate import Calibration, Found, HeldOut, prior_of
from warp_trunk.cohort.calibration.free_constants import FreeConstant
from warp_trunk.cohort.calibration.report import calibration_text, write_calibration
from warp_trunk.cohort.statistics import over_patients

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
