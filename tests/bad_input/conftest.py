"""A good case, made once and copied for each row of a table."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from support.small_case import small_case
from warp_trunk.case import write_case
from warp_trunk.cli import main
from warp_trunk.cli.output import BAD_INPUT


@pytest.fixture(scope="session")
def good_case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case that passes every check; not to be changed."""
    folder = tmp_path_factory.mktemp("good") / "case"
    write_case(folder, small_case())
    return folder


@pytest.fixture
def case(good_case: Path, tmp_path: Path) -> Path:
    """A copy of it, to be broken."""
    return Path(shutil.copytree(good_case, tmp_path / "case"))


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs a command that must end in status 2 and one line that holds all the fragments; returns the line."""

    def run(arguments: list[str], *fragments: str) -> str:
        assert main(arguments) == BAD_INPUT
        said = capsys.readouterr()
        assert said.out == ""
        assert "Traceback" not in said.err
        errors = [line for line in said.err.splitlines() if line.startswith("warp-trunk: ")]
        assert errors == said.err.splitlines()[-1:]
        assert [fragment for fragment in fragments if fragment not in errors[0]] == [], errors[0]
        return errors[0]

    return run
