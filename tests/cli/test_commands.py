"""The command line: its commands, flags and exit statuses, one line for an error, and cases left alone."""

import json
import os
import shlex
import subprocess
import sys
from dataclasses import fields, replace
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace

import pytest

import warp_trunk
from support.blocks import spine_and_hips
from support.report_results import write_small_result
from support.small_case import small_case
from warp_trunk.case import write_case
from warp_trunk.case.landmarks import read_landmarks
from warp_trunk.cli import main
from warp_trunk.cli.arguments import ONLY_IN_PYTHON
from warp_trunk.cli.commands import COMMANDS, load
from warp_trunk.cli.output import BAD_INPUT, NOT_CONVERGED, OK, next_command
from warp_trunk.cli.simulate import COMMON
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.tissue import Tissue
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.io.surface_files import write_surface
from warp_trunk.meshing import MeshOptions
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.recording import viewer
from warp_trunk.run.options import RunOptions
from warp_trunk.spine import cobb_angles
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


def flags(text: str) -> set[str]:
    """The options that a help lists, without the other halves of switches."""
    words = [row.strip("│ ").split(" ")[0].strip(",") for row in text.splitlines()]
    return {word for word in words if word.startswith("--")}


def test_help_shows_what_people_set_and_the_whole_help_the_rest(capsys: pytest.CaptureFixture[str]) -> None:
    said = {}
    for word in ("--help", "--help-all"):
        with pytest.raises(SystemExit) as end:
            main(["simulate", word])
        assert end.value.code == 0
        said[word] = capsys.readouterr().out
    short, whole = flags(said["--help"]), flags(said["--help-all"])
    assert 10 <= len(short) <= 17
    assert short < whole
    assert {f"--{name.replace('_', '-')}" for name in COMMON} | {
        "--out",
        "--plan",
        "--align-pelvis",
        "--papers",
    } <= short
    options = {field.name for kind in (RunOptions, MeshOptions, RelaxOptions, Tissue) for field in fields(kind)}
    shown = {flag.removeprefix("--").replace("-", "_") for flag in whole}
    assert options - {"mesh", "simulation"} - shown == ONLY_IN_PYTHON
    assert "--help-all" in said["--help"]
    assert "Requested number of tetrahedra" in said["--help"]  # documented at the field of the option


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


def test_make_case_writes_a_case_of_the_curve_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    skin, bones = straight_trunk()[0], spine_and_hips()
    (tmp_path / "bones").mkdir()
    for name, surface in bones.items():
        write_surface(tmp_path / "bones" / f"{name}.ply", surface)
    (tmp_path / "bones" / "SOURCE.md").write_text("not a bone", encoding="utf-8")
    write_surface(tmp_path / "skin.ply", skin)
    flags = ["--curve=double_major", "--cobb=45", "--correction=0.6", "--direction=left"]
    files = ["--skin", str(tmp_path / "skin.ply"), "--bones", str(tmp_path / "bones")]
    assert main(["make-case", *files, "--out", str(tmp_path / "case"), *flags]) == OK
    assert "warp-trunk simulate" in capsys.readouterr().out
    assert {path.stem for path in (tmp_path / "case" / "bones").iterdir()} == set(bones)
    before, after = (read_landmarks(tmp_path / "case" / f"landmarks_{when}.csv") for when in ("before", "after"))
    for landmarks, cobb in ((before, 45.0), (after, 0.4 * 45.0)):
        assert max(curve.angle for curve in cobb_angles(landmarks)) == pytest.approx(cobb, abs=2.0)
    thoracic, lumbar = (before.of_bone(bone).points[:, 0].mean() for bone in ("T8", "L2"))
    assert lumbar < 0.0 < thoracic  # the thoracic curve is convex to the left, the lumbar one to the right


def test_view_opens_the_recording_on_the_loopback_address_only(tmp_path, monkeypatch, capsys):
    (tmp_path / "recording.rrd").write_bytes(b"")
    started = []

    def run(command, env, check):
        started.append(command)
        return SimpleNamespace(returncode=0)

    monkeypatch.setattr(viewer, "subprocess", SimpleNamespace(run=run))  # Warp asks others of the machine
    monkeypatch.setenv("DISPLAY", ":0")
    assert main(["view", str(tmp_path)]) == OK
    (command,) = started
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert command[-1] == str(tmp_path / "recording.rrd")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    assert main(["view", str(tmp_path)]) == BAD_INPUT
    assert "there is no display for the viewer's window; use `view --web`" in capsys.readouterr().err


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
        ("demo", "case/results/new"),
        ("demo", "link/there"),
    ],
)
@pytest.mark.parametrize("header", [True, False], ids=["case.toml", "skin and bones"])
def test_a_case_is_left_alone(command, place, header, result, refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_case(tmp_path / "case", small_case())
    (tmp_path / "link").symlink_to(tmp_path / "case")
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


def test_the_demo_takes_another_mesh_and_refuses_its_own_options_beside_one(refused, tmp_path):
    """The settings of the demo's own mesh were not given."""
    refused(["demo", "--from-mesh", tmp_path / "a.vtu", "--out", tmp_path / "o"], "a.vtu: there is no such file")
    refused(["demo", "--from-mesh", tmp_path / "a.vtu", "--tets", "5000"], "--tets: is not used with --from-mesh")
