"""What is mistyped ends in one line that names the option, the value and the cure."""

import pytest

from warp_trunk.cli import main
from warp_trunk.cli.arguments import ONLY_IN_PYTHON, whole_number
from warp_trunk.cli.output import BAD_INPUT

FILES = ["--skin", "s.ply", "--bones", "b", "--out", "c"]
TYPOS = [
    ([], ["a command is needed", "simulate", "warp-trunk demo"]),
    (["simulat", "case"], ["'simulat': there is no such command (did you mean simulate?)", "make-case"]),
    (["xyz"], ["'xyz': there is no such command; known are demo, doctor"]),
    (["simulate", "case", "--tet", "5"], ["--tet", "--tets INT", "warp-trunk simulate --help-all"]),
    (["simulate", "case", "--tet=5"], ["--tet=5"]),
    (["simulate", "case", "--xyzzy", "5"], ["--xyzzy", "warp-trunk simulate --help-all"]),
    (["make-case", *FILES, "--side", "left"], ["--side", "warp-trunk make-case --help lists"]),
    (["make-case", "--skin", "s.ply"], ["--bones PATH --out PATH"]),
    (["simulate"], ["PATH"]),
    (["simulate", "case", "--out"], ["--out"]),
    (["simulate", "case", "--tets", "1e5x"], ["--tets", "'1e5x'"]),
    (["simulate", "case", "--increments", "2.5"], ["--increments", "not a whole number: '2.5'"]),
    (["simulate", "case", "--poisson-ratio", "much"], ["--poisson-ratio", "'much'"]),
    (["simulate", "case", "--bones", "folow"], ["'folow'", "--bones", "'follow', 'spline'"]),
    (["simulate", "case", "--layers", "deep"], ["'deep'", "--layers", "'depth'"]),
    (["simulate", "case", "--tets", "5", "--tets=6"], ["--tets: is given more than once"]),
    (["simulate", "case", "--tets", "1e9"], ["warp-trunk: mesh: 'tets' must be a number from 4 to 5e+07"]),
    (["simulate", "case", "--theta", "nan"], ["warp-trunk: tissue: 'theta' must be a finite number"]),
    (["simulate", "case", "another"], ["another"]),
    *(
        (["simulate", "case", f"--{name.replace('_', '-')}", "1"], ["Unrecognized"])
        for name in sorted(ONLY_IN_PYTHON)
    ),
]


@pytest.mark.parametrize(("arguments", "said"), TYPOS)
def test_a_typo_is_told_in_one_line(arguments, said, capsys):
    assert main(arguments) == BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("warp-trunk: ")
    assert [part for part in said if part not in line] == [], line
    assert not set(line) & set("╭│─\x1b")


def test_whole_numbers_may_have_an_exponent(capsys):
    assert [whole_number(text) for text in ("7", "1e5", "2.0")] == [7, 100_000, 2]
    assert main(["simulate", "no/such/case", "--tets", "1e5"]) == BAD_INPUT
    assert "no/such/case: there is no such folder" in capsys.readouterr().err


def test_a_file_in_place_of_a_case_folder_is_said_to_be_one(tmp_path, capsys):
    (tmp_path / "case.toml").write_text('units = "mm"')
    assert main(["simulate", str(tmp_path / "case.toml")]) == BAD_INPUT
    assert "case.toml: is a file; a case folder with case.toml was expected" in capsys.readouterr().err
