"""The command line: its commands, flags and exit statuses, one line for an error, and cases left alone."""

import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import pytest

import warp_trunk
from support.phantoms import coarse_phantom
from support.report_results import write_small_result
from support.shown import check_shown
from support.small_case import small_case
from warp_trunk.case import write_case
from warp_trunk.cli import main
from warp_trunk.cli.arguments import ONLY_IN_PYTHON
from warp_trunk.cli.commands import COMMANDS
from warp_trunk.cli.output import NOT_CONVERGED, OK, next_command
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.preparation import phantom
from warp_trunk.system import usable_cores

LOADED = """
import sys
from warp_trunk.cli import main
assert main(["--help"]) == 0
heavy = {"warp", "numpy", "scipy", "trimesh", "rerun", "matplotlib", "tyro"} & set(sys.modules)
print(sorted(heavy), file=sys.stderr)
"""

THREADS = """
import os, sys
from warp_trunk.cli import main
sys.argv = ["warp-trunk", "--help"]
main()
import numpy
numpy.ones((500, 500)) @ numpy.ones((500, 500))
print(len(os.listdir("/proc/self/task")), file=sys.stderr)
"""


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"warp-trunk {warp_trunk.__version__}\n"
    assert warp_trunk.__version__ == metadata.version("warp-trunk")


def test_what_is_printed_into_a_file_is_utf_8() -> None:
    """Windows writes it in a code page without a minus sign, and `plan --out` failed at its table."""
    code = r"import sys; sys.argv[1:] = ['--version']; from warp_trunk.cli import main; main(); print('\u2212')"
    plain = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run([sys.executable, "-c", code], env=plain, capture_output=True, check=True)
    assert done.stdout.decode("utf-8").splitlines()[1] == "\u2212"


def test_help_loads_nothing_heavy() -> None:
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, encoding="utf-8", check=True)
    assert done.stderr.splitlines()[-1] == "[]"


@pytest.mark.parametrize(("asked", "threads"), [({}, 1), ({"OPENBLAS_NUM_THREADS": "2"}, 2)])
def test_products_of_matrices_have_one_thread_unless_more_are_asked_for(asked: dict[str, str], threads: int):
    if usable_cores() < threads:
        pytest.skip("needs two cores")
    environment = {name: value for name, value in os.environ.items() if "NUM_THREADS" not in name} | asked
    command = [sys.executable, "-c", THREADS]
    done = subprocess.run(command, env=environment, capture_output=True, encoding="utf-8", check=True)
    assert done.stderr.splitlines()[-1] == str(threads)


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


@pytest.mark.slow
def test_flags_reach_the_run_and_the_rest_is_the_cases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WARP_TRUNK_CACHE", str(tmp_path / "cache"))
    case = small_case()
    write_case(tmp_path / "case", replace(case, skin=coarsen(case.skin, 40.0, 4.0)))

    def simulated(flags: str) -> int:
        usual = f"--out {tmp_path} --tets=8000 --increments=2 --device=cpu --threads=1 --no-record"
        return main(["simulate", str(tmp_path / "case"), *usual.split(), *flags.split()])

    assert simulated("--precision=float64 --max-steps=400 --tolerance=50 --density=900 --gravity=9.81") == OK
    parameters = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["parameters"]
    assert parameters | {
        "tets": 8000, "increments": 2, "device": "cpu", "precision": "float64", "threads": 1,
        "max_steps": 400, "tolerance": 50.0, "density": 900.0, "record": False,
        "poisson_ratio": small_case().tissue.poisson_ratio,
    } == parameters  # fmt: skip
    assert not (tmp_path / "recording.rrd").exists()
    assert simulated("--max-steps=1 --tolerance=1e-4") == NOT_CONVERGED


PLACES = (
    ("report RESULT", "case"), ("report RESULT", "case/pages"), ("report RESULT RESULT", "case"),
    ("export RESULT", "case/skin.vtu"), ("plan case --uiv T4 --liv L1", "case/planned"),
    ("plan case --uiv T4 --liv L1", "case/bones"), ("demo", "case/results/new"), ("demo", "link/there"),
)  # fmt: skip
KINDS = (
    "report cases/a", "view cases/a", "export cases/a --out a.vtu", "measure cases/a", "report cases/a/bones",
    "report cases", "report results", "simulate cases", "simulate cases/a/bones", "simulate results/r",
    "cohort results --out results", "cohort results/r --out more", "cohort cases/a --out more",
    "cohort cases --out cases",
)  # fmt: skip


def test_lines_on_cases_that_are_left_alone_and_on_folders_of_another_kind_are_as_accepted(
    refused_row: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each names the command that takes the folder; a case with a header and one without it stay as they are."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(phantom, "phantom_case", coarse_phantom)
    write_case("case", small_case())
    shutil.copytree("case", "cases/a")
    Path("link").symlink_to(tmp_path / "case")
    result, lines = write_small_result(tmp_path / "results" / "r"), []
    for header in (True, False):
        if not header:
            Path("case/case.toml").unlink()
        before = sorted((path, path.read_bytes()) for path in Path("case").rglob("*") if path.is_file())
        for command, place in PLACES:
            words = command.replace("RESULT", str(result)).split()
            lines.append(refused_row(f"{command} --out {place}", [*words, "--out", place]))
        assert sorted((path, path.read_bytes()) for path in Path("case").rglob("*") if path.is_file()) == before
    lines += [refused_row(words, words.split()) for words in KINDS]
    check_shown("refused_folders", lines)


@pytest.mark.filterwarnings("error")  # which tyro gives of a field with a wrong default
def test_help_is_as_accepted(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """The overview, and every option of every command with its default and unit."""
    monkeypatch.setenv("COLUMNS", "2000")
    main(["--help"])
    lines = capsys.readouterr().out.splitlines()
    for words in ([name, "--help-all"] for name in COMMANDS):
        lines += ["", *help_of(words, capsys)]
    for name in ("simulate", "plan", "demo"):  # the options that are set most
        lines += ["", *(line.split("  ")[0] for line in help_of([name, "--help"], capsys))]
    assert not [line for line in lines if "None" in line]  # a word of Python's, not of a command line
    check_shown("help", lines)


def help_of(words: list[str], capsys: pytest.CaptureFixture[str]) -> list[str]:
    """A help without its frames, an option in each line."""
    with pytest.raises(SystemExit) as end:
        main(words)
    assert end.value.code == 0
    lines = list[str]()
    for row in capsys.readouterr().out.splitlines():
        text = row.strip("│╭╮╰╯─ ") if set(row) - {"-"} else ""
        if row.startswith("│     ") and lines:
            lines[-1] += f"  {text}"
        elif text:
            lines.append(text)
    return lines
