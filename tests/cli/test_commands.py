"""The commands by name, and what is loaded for them."""

import subprocess
import sys
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


def test_no_file_of_a_command_is_left_out() -> None:
    found = {path for path in CLI.glob("*.py") if "def run(self, arguments" in path.read_text()}
    assert found == {Path(load([name]).run.__code__.co_filename) for name in COMMANDS}


def test_help_loads_nothing_heavy() -> None:
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    assert done.stderr.splitlines()[-1] == "[]"
