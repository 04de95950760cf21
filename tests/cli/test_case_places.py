"""Output of a command about a result or a case does not land among the files of a case."""

from pathlib import Path

import pytest

from support.report_results import write_small_result
from support.small_case import small_case
from warp_trunk.case import write_case
from warp_trunk.cli import main


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
def test_a_case_is_left_alone(
    command: str,
    place: str,
    result: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    write_case(tmp_path / "case", small_case())
    before = sorted((path, path.read_bytes()) for path in tmp_path.rglob("*") if path.is_file())
    assert main([*command.replace("RESULT", str(result)).split(), "--out", place]) == 2
    assert "case folder" in capsys.readouterr().err
    assert sorted((path, path.read_bytes()) for path in tmp_path.rglob("*") if path.is_file()) == before
