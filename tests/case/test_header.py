"""case.toml is read and written, with its table [study]."""

from __future__ import annotations

import pytest

from warp_trunk.case import Axes
from warp_trunk.case.header import CaseHeader, header_text, read_header
from warp_trunk.case.study import Study
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
        axes=Axes("ASR"),
        tissue=Tissue(epsilon=0.1 + 0.2, theta=1e-9, density=1e17, youngs_modulus=3),
        uncertainty=Uncertainty(cobb=0.1 + 0.2, theta=7),
    )
    assert read(tmp_path, header_text(header)) == header


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ('axis = "LPS"', "unknown key 'axis'; did you mean 'axes'? the keys are name, units, axes"),
        (
            "[tissue]\ntheata = 1",
            "unknown key 'tissue.theata'; did you mean 'tissue.theta'? the keys are tissue.ep",
        ),
        ("zzz = 1", "unknown key 'zzz'; the keys are name"),
        ("name = 7", "'name': Expected `str`, got `int`"),
        ("tissue = 1", "'tissue' must be a table, [tissue], not 1"),
        ("[tissue]\ntheta = true", "'tissue': Expected `float`, got `bool` - at `$.theta`"),
        ("[tissue]\ndensity = -1", "'density' must be a finite number of at least 1e-09, not -1.0"),
        ("[tissue]\nepsilon = nan", "'epsilon' must be a finite number of at least 0, not nan"),
        ("[uncertainty]\nrib = 1", "unknown key 'uncertainty.rib'; did you mean 'uncertainty.ribs'?"),
        ("[uncertainty]\ncobb = -1", "'cobb' must be a number from 0 to 1000, not -1.0"),
        ("[uncertainty]\ntheta = 0.5", "'theta' must be a number from 1 to 1000, not 0.5"),
        ("[uncertainty]\nmesh_length = nan", "'mesh_length' must be a number from 0 to 1000, not nan"),
        ('units = "inch"', "'units' must be mm or cm or m, not 'inch'"),
        ("[study]\npatiant = 'a'", "unknown key 'study.patiant'; did you mean 'study.patient'?"),
        ("[study]\npose = 'lying'", "Invalid enum value 'lying' - at `$.pose`"),
        ("[study]\nmonths_after = -1", "'months_after' must be from 0 to 1200 months, not -1"),
        ('axes = "LRS"', "one letter of L R, one of P A and one of S I, not 'LRS'"),
        ("name = ", "cannot be read as TOML"),
    ],
)
def test_bad_files_are_refused(tmp_path, text, rule):
    with pytest.raises(InputError) as error:
        read(tmp_path, text)
    assert str(error.value).startswith(f"{tmp_path / 'case.toml'}: ")
    assert rule in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"case\.toml: there is no such file"):
        read_header(tmp_path / "case.toml")


@pytest.mark.parametrize(
    "study",
    [Study(), Study(patient='P "1"', pose="bending", months_after=0.1 + 0.2, virtual=True), Study(virtual=True)],
)
def test_a_study_comes_back(tmp_path, study):
    path = tmp_path / "case.toml"
    path.write_text(header_text(CaseHeader(name="x", study=study)), encoding="utf-8")
    assert read_header(path).study == study
    assert ("[study]" in path.read_text()) == (study != Study())
