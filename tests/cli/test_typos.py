"""What is mistyped ends in one line that names the option, the value and the cure."""

import pytest

from warp_trunk.cli import main
from warp_trunk.cli.arguments import whole_number
from warp_trunk.cli.exit_status import BAD_INPUT

FILES = ["--skin", "s.ply", "--bones", "b", "--out", "c"]
TYPOS = [
    ([], ["a command is needed", "simulate", "warp-trunk demo"]),
    (["simulat", "case"], ["'simulat': there is no such command (did you mean simulate?)", "make-case"]),
    (["xyz"], ["'xyz': there is no such command; known are demo, doctor"]),
    (["simulate", "case", "--tet", "5"], ["--tet: simulate has no such option (did you mean --tets?)"]),
    (["simulate", "case", "--tet=5"], ["--tet: simulate has no such option (did you mean --tets?)"]),
    (["simulate", "case", "--xyzzy", "5"], ["--xyzzy: simulate has no such option; warp-trunk simulate --help"]),
    (["make-case", "--side", "left"], ["--side: make-case has no such option (did you mean --direction left?)"]),
    (["make-case", *FILES, "--side", "left"], ["did you mean --direction left?"]),
    (["make-case", "--skin", "s.ply"], ["--bones PATH and --out PATH must be given too"]),
    (["simulate"], ["simulate: PATH must be given too"]),
    (["simulate", "case", "--out"], ["--out: needs a path after it; write --out PATH"]),
    (
        ["simulate", "case", "--tets", "1e5x"],
        ["--tets: must be a whole number, not '1e5x'; write for example"],
    ),
    (["simulate", "case", "--increments", "2.5"], ["--increments: must be a whole number, not '2.5'"]),
    (["simulate", "case", "--poisson-ratio", "much"], ["--poisson-ratio: must be a number, not 'much'"]),
    (["simulate", "case", "--bones", "folow"], ["--bones: must be one of ", "not 'folow' (did you mean follow?)"]),
    (["simulate", "case", "--tets", "5", "--tets=6"], ["--tets: is given more than once"]),
    (["simulate", "case", "--tets", "1e9"], ["warp-trunk: mesh: 'tets' must be a number from 4 to 5e+07"]),
    (["simulate", "case", "--theta", "nan"], ["warp-trunk: tissue: 'theta' must be a finite number"]),
    (["simulate", "case", "another"], ["simulate: 'another' is too much"]),
]


@pytest.mark.parametrize(("arguments", "said"), TYPOS)
def test_a_typo_is_told_in_one_line(arguments, said, capsys):
    assert main(arguments) == BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("warp-trunk: ")
    assert [part for part in said if part not in line] == [], line


def test_whole_numbers_may_have_an_exponent(capsys):
    assert [whole_number(text) for text in ("7", "1e5", "2.0")] == [7, 100_000, 2]
    assert main(["simulate", "no/such/case", "--tets", "1e5"]) == BAD_INPUT
    assert "no/such/case: there is no such folder" in capsys.readouterr().err


def test_a_file_in_place_of_a_case_folder_is_said_to_be_one(tmp_path, capsys):
    (tmp_path / "case.toml").write_text('units = "mm"')
    assert main(["simulate", str(tmp_path / "case.toml")]) == BAD_INPUT
    assert "case.toml: is a file; a case folder with case.toml was expected" in capsys.readouterr().err
