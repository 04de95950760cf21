"""The table [study] of case.toml."""

import pytest

from warp_trunk.case.header import CaseHeader, header_text, read_header
from warp_trunk.case.study import Study
from warp_trunk.errors import InputError


@pytest.mark.parametrize(
    "study",
    [Study(), Study(patient='P "1"', pose="bending", months_after=0.1 + 0.2, virtual=True), Study(virtual=True)],
)
def test_round_trip(tmp_path, study):
    path = tmp_path / "case.toml"
    path.write_text(header_text(CaseHeader(name="x", study=study)), encoding="utf-8")
    assert read_header(path).study == study
    assert ("[study]" in path.read_text()) == (study != Study())


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("study = 1", "'study' must be a table, [study], not 1"),
        ("[study]\npatiant = 'a'", "unknown key 'study.patiant'; did you mean 'study.patient'?"),
        ("[study]\npatient = 7", "'study.patient' must be text, not 7"),
        ("[study]\npose = 'lying'", "'pose' must be one of surgery, bending, not 'lying'"),
        ("[study]\nmonths_after = -1", "'months_after' must be from 0 to 1200 months, not -1"),
        ("[study]\nmonths_after = nan", "'study.months_after' must be a number"),
        ("[study]\nmonths_after = true", "'study.months_after' must be a number, not True"),
        ("[study]\nvirtual = 'yes'", "'study.virtual' must be true or false, not 'yes' (str)"),
    ],
)
def test_refused(tmp_path, text, rule):
    path = tmp_path / "case.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_header(path)
    assert str(error.value).startswith(str(path))
    assert rule in str(error.value)
