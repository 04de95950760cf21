"""The commands by name, words that are typed wrongly, and command lines to paste."""

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from warp_trunk.cli import main
from warp_trunk.cli.arguments import ONLY_IN_PYTHON
from warp_trunk.cli.commands import COMMANDS, load
from warp_trunk.cli.output import next_command

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
def test_help_is_of_the_command_line(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main([name, "--help"])
    assert end.value.code == 0
    said = capsys.readouterr().out
    assert "None" not in said  # a word of Python's, not of a command line


def test_help_loads_nothing_heavy() -> None:
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    assert done.stderr.splitlines()[-1] == "[]"


@pytest.mark.parametrize(("under_uv", "start"), [(True, ["uv", "run", "warp-trunk"]), (False, ["warp-trunk"])])
def test_it_is_quoted_for_a_shell_and_starts_as_this_run_did(monkeypatch, under_uv: bool, start: list[str]):
    if under_uv:
        monkeypatch.setenv("UV_RUN_RECURSION_DEPTH", "1")
    else:
        monkeypatch.delenv("UV_RUN_RECURSION_DEPTH", raising=False)
    words = ["simulate", Path("Anna Müller") / "T4 & L1", "--out", "it's"]
    assert shlex.split(next_command(*words)) == [*start, *map(str, words)]
    assert next_command("view", "results/anna") == " ".join([*start, "view results/anna"])


TYPOS = [
    ([], ["a command is needed", "simulate", "warp-trunk demo"]),
    (["simulat", "case"], ["'simulat': there is no such command (did you mean 'simulate'?)", "make-case"]),
    (["simulate", "case", "--tet", "5"], ["--tet", "--tets INT", "warp-trunk simulate --help-all"]),
    (["make-case", "--skin", "s.ply"], ["--bones PATH --out PATH"]),
    (["simulate", "case", "--tets", "1e5x"], ["--tets", "'1e5x'"]),
    (["simulate", "case", "--bones", "folow"], ["'folow'", "--bones", "'follow', 'spline'"]),
    (["simulate", "case", "--tets", "5", "--tets=6"], ["--tets: is given more than once"]),
    (["simulate", "case", "--theta", "nan"], ["warp-trunk: tissue: 'theta' must be a finite number"]),
    (["simulate", "case", "another"], ["another"]),
    *(
        (["simulate", "case", f"--{name.replace('_', '-')}", "1"], ["Unrecognized"])
        for name in sorted(ONLY_IN_PYTHON)
    ),
]


@pytest.mark.parametrize(("arguments", "said"), TYPOS)
def test_a_typo_is_told_in_one_line(arguments, said, refused):
    assert not set(refused(arguments, *said)) & set("╭│─\x1b")
