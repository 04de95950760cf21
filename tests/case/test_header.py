"""case.toml is read and written, with its table [study]."""

import pytest

from support.asserting import refuses
from warp_trunk.case.case import Study
from warp_trunk.case.header import CaseHeader, header_text, read_header
from warp_trunk.case.uncertainty import Uncertainty
from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError


def read(tmp_path, text):
    path = tmp_path / "case.toml"
    path.write_text(text, encoding="utf-8")
    return read_header(path)


def test_an_empty_file_has_the_defaults(tmp_path):
    assert read(tmp_path, "") == CaseHeader(name=tmp_path.name)


@pytest.mark.parametrize("name", ["", 'quote " and \\ back', "tab\tnewline\nDEL\x7fbell\x07", "Ω 脊柱 🦴"])
def test_round_trip(tmp_path, name):
    header = CaseHeader(
        name=name,
        units="cm",
        axes="ASR",
        tissue=Tissue(epsilon=0.1 + 0.2, theta=1e-9, density=1e17, youngs_modulus=3),
        uncertainty=Uncertainty(cobb=0.1 + 0.2, theta=7),
    )
    assert read(tmp_path, header_text(header)) == header


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ('axis = "LPS"', "unknown key 'axis' (did you mean 'axes'?); the keys are name, units, axes"),
        ("tissue = 1", "'tissue' must be a table, not 1"),
        ("[tissue]\ntheta = true", "'tissue.theta' must be a number, not True"),
        ("[tissue]\nepsilon = nan", "'epsilon' must be a finite number of at least 0, not nan"),
        ("[uncertainty]\ncobb = -1", "'uncertainty.cobb' must be a number >= 0.0, not -1; the nearest is 0"),
        (
            "[study]\npose = 'lying'",
            "must be bending or surgery, not 'lying' (did you mean 'bending'?)",
        ),
        ("[study]\nmonths_after = -1", "'study.months_after' must be a number >= 0.0, not -1"),
    ],
)
def test_bad_files_are_refused(tmp_path, text, rule):
    with refuses(rule, begins=f"{tmp_path / 'case.toml'}: "):
        read(tmp_path, text)


@pytest.mark.parametrize(
    "study",
    [
        Study(),
        Study(patient='P "1"', pose="bending", months_after=0.1 + 0.2, synthetic=True),
        Study(synthetic=True),
    ],
)
def test_a_study_comes_back(tmp_path, study):
    path = tmp_path / "case.toml"
    path.write_text(header_text(CaseHeader(name="x", study=study)), encoding="utf-8")
    assert read_header(path).study == study
    assert ("[study]" in path.read_text()) == (study != Study())


def test_a_former_key_is_read_but_not_beside_its_present_one(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text("[study]\nvirtual = true\n")
    assert read_header(path).study.synthetic
    path.write_text("[study]\nvirtual = true\nsynthetic = true\n")
    with pytest.raises(InputError, match=r"unknown key 'study\.virtual'"):
        read_header(path)
