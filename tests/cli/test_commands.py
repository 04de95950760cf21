"""The commands by name, and what is loaded for them."""

import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from warp_trunk.cli import main
from warp_trunk.cli.commands import COMMANDS, load

CLI = Path(load(["demo"]).run.__code__.co_filename).parent
LOADED = """
import sys
from warp_trunk.cli import main
assert main(["--help"]) == 0
heavy = {"warp", "numpy", "scipy", "trimesh", "rerun", "matplotlib", "tyro"} & set(sys.modules)
print(sorted(heavy), file=sys.stderr)
"""


def test_every_command_is_shown_with_its_first_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    for name in COMMANDS:
        sentence = " ".join(load([name]).__doc__.split("\n\n")[0].split())
        assert f"{name} {sentence}" in said


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_a_paragraph_for_each_option(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit) as end:
        main([name, "--help"])
    assert end.value.code == 0
    said = capsys.readouterr().out
    assert "None" not in said  # a word of Python's, not of a command line
    rows = [row.strip("│").rstrip() for row in said.split("\n\n", maxsplit=1)[1].splitlines()]  # without the usage
    assert any(row.startswith("  -") for row in rows)
    column = max(len(row) - len(row.lstrip()) for row in rows)  # where help stands
    column = max(column, 8)  # nothing takes two rows in short help
    widest = max((len(row) for row in rows if row[:column].isspace()), default=0)
    within = [
        (one, row.split()[0])
        for one, row in pairwise(rows)
        if row[:column].isspace() and one[column - 2 : column].isspace() and one[column:]
    ]
    assert [pair for pair in within if len(f"{pair[0]} {pair[1]}") <= widest] == []


def test_no_file_of_a_command_is_left_out() -> None:
    found = {path for path in CLI.glob("*.py") if "def run(self, arguments" in path.read_text()}
    assert found == {Path(load([name]).run.__code__.co_filename) for name in COMMANDS}


def test_help_loads_nothing_heavy() -> None:
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    assert done.stderr.splitlines()[-1] == "[]"
