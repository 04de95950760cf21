"""Output of a command about a result or a case does not land among the files of a case."""

from pathlib import Path

import pytest

from support.report_results import write_small_result
from support.small_case import small_case
from warp_trunk.case import write_case


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_small_result(tmp_path_factory.mktemp("places"))


@pytest.mark.parametrize(
    ("command", "place"),
    [
        ("report RESULT", "case"),
        ("report RESULT", "case/pages"),
        ("report RESULT RESULT", "case"),
        ("export RESULT", "case/skin.vtu"),
        ("plan case --uiv T4 --liv L1", "case/planned"),
        ("plan case --uiv T4 --liv L1", "case/bones"),
    ],
)
@pytest.mark.parametrize("header", [True, False], ids=["case.toml", "skin and bones"])
def test_a_case_is_left_alone(command, place, header, result, refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_case(tmp_path / "case", small_case())
    if not header:
        (tmp_path / "case" / "case.toml").unlink()
    before = sorted((path, path.read_bytes()) for path in tmp_path.rglob("*") if path.is_file())
    refused([*command.replace("RESULT", str(result)).split(), "--out", place], "case folder")
    assert sorted((path, path.read_bytes()) for path in tmp_path.rglob("*") if path.is_file()) == before


@pytest.mark.parametrize(
    ("command", "cure"),
    [
        ("report cases/a", "it is a case; simulate it first (warp-trunk simulate cases/a)"),
        ("view cases/a", "it is a case; simulate it first"),
        ("export cases/a --out a.vtu", "it is a case; simulate it first"),
        ("measure cases/a", "warp-trunk measure cases/a/skin.ply --case cases/a"),
        ("report cases/a/bones", "simulate it first (warp-trunk simulate cases/a)"),
        ("report cases", "it holds cases, such as cases/a"),
        ("report results", "give one of those in it, such as results/r"),
        ("simulate cases", "give one of those in it, such as cases/a"),
        ("simulate cases/a/bones", "give cases/a, around it"),
        ("simulate results/r", "it is a result; report, view, measure and export take it"),
        ("cohort results --out results", "it holds results, such as results/r; give their cases"),
        ("cohort results/r --out more", "it is a result; a folder of cases is wanted"),
        ("cohort cases/a --out more", "is one case"),
        ("cohort cases --out cases", "holds the cases"),
    ],
)
def test_a_folder_of_another_kind_is_named_with_the_command_that_takes_it(
    command, cure, result, refused, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    write_case(tmp_path / "cases" / "a", small_case())
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "r").symlink_to(result)
    refused(command.split(), cure)
