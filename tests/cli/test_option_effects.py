"""No option is accepted and ignored: with it, each command asks for something else, or refuses it.

The table has every option of every command, with another value than its default; a new option fails until it has
one. That forces and results follow is tested in `tests/run/test_options.py`, what the other commands write in the
tests of their parts.
"""

import dataclasses
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import warp_trunk.cli.cohort as cohort_command
import warp_trunk.cli.plan as plan_command
import warp_trunk.cli.simulate as simulate_command
import warp_trunk.recording as recording
from support.phantoms import coarse_phantom
from warp_trunk.case import read_checked_case, write_case
from warp_trunk.case.anatomy import PELVIC_RING, VERTEBRAE
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.cli import back, doctor, films, import_case, main, measure, result, surfaces
from warp_trunk.cli.commands import COMMANDS
from warp_trunk.cohort import one_case
from warp_trunk.errors import InputError
from warp_trunk.live import opening
from warp_trunk.preparation import phantom
from warp_trunk.preparation.label_maps import skin as label_skin
from warp_trunk.report import writing

SIMULATION = {
    "--energy": "itmsm", "--weights": "volume", "--skin-rigidity": "0.1", "--precision": "float64",
    "--gravity": "9.81", "--alpha": "0.1", "--rest": "scan", "--layers": "depth", "--bones": "spline",
    "--bands": "", "--from-mesh": "FOLDER/mesh.vtu", "--tets": "9000", "--increments": "3", "--tolerance": "0.3",
    "--max-steps": "7", "--method": "gradient", "--device": "cpu", "--threads": "2", "--no-cache": "",
    "--no-record": "", "--view": "", "--yes": "", "--bone-voxel": "5", "--bone-tolerance": "1.1",
    "--bone-edge-length": "9", "--bone-margin": "0.7",
}  # fmt: skip
CONSTANTS = {
    "--epsilon": "2", "--theta": "20", "--poisson-ratio": "0.4", "--density": "900", "--youngs-modulus": "30",
    "--papers": "", "--align-pelvis": "", "--tissue-file": "FOLDER/tissue.toml",
}  # fmt: skip
CASES = {"--workers": "2", "--scheduler": "tcp://a:1"}
INTENTION = {
    "--uiv": "T5", "--liv": "L2", "--curve": "T8,correction=0.5", "--kyphosis-T5-T12": "30",
    "--lordosis-L1-L5": "30", "--unfused": "fixed", "--spontaneous": "0.2", "--balance": "centre",
    "--sva-after": "5",
}  # fmt: skip
CUTS = {"--cut-above": "400", "--cut-below": "-90", "--cut": "0,0,0,1,0,0,50"}
TABLE: dict[str, dict[str, str]] = {
    "simulate": SIMULATION | CONSTANTS | {
        "--out": "FOLDER/other", "--motions": "FOLDER/motions.toml", "--plan": "FOLDER/plan.toml",
    },
    "cohort": SIMULATION | CONSTANTS | CASES | {"--out": "FOLDER/other"},
    "calibrate": SIMULATION | CONSTANTS | CASES | {
        "--free": "theta", "--pose": "bending", "--no-priors": "", "--out": "FOLDER/other.toml",
    },
    "plan": SIMULATION | INTENTION | {
        "--out": "FOLDER/other", "--plan": "FOLDER/other.toml", "--aim": "bsr",
        "--within": "T8,correction=0.3..0.6", "--predict": "", "--live": "", "--port": "9000",
    },
    "demo": {name: value for name, value in SIMULATION.items() if name != "--bands"} | {
        "--out": "FOLDER/other", "--no-bands": "",
    },
    "doctor": {"--results": "FOLDER/other"},
    "close": CUTS | {
        "--out": "FOLDER/b.ply", "--transforms": "FOLDER/a.txt FOLDER/b.txt", "--refine": "", "--smoothing": "2",
        "--edge-length": "5",
    },
    "triangulate": {
        "--pa": "FOLDER/x.csv", "--pa-matrix": "FOLDER/x.txt", "--lateral": "FOLDER/x.csv",
        "--lateral-matrix": "FOLDER/x.txt", "--out": "FOLDER/b.csv", "--limit": "3", "--noise": "0.5",
    },
    "register": {
        "--skin": "FOLDER/x.ply", "--on-skin": "FOLDER/x.csv", "--on-films": "FOLDER/x.csv",
        "--out": "FOLDER/b.ply", "--nugget": "2",
    },
    "fit-atlas": {
        "--bones": "FOLDER/x", "--atlas": "FOLDER/x.csv", "--patient": "FOLDER/x.csv", "--out": "FOLDER/fit_b",
        "--skin": "FOLDER/x.ply", "--atlas-skin": "FOLDER/x.ply", "--drift": "constant", "--nugget": "2",
    },
    "fit-back": {
        "--spine": "FOLDER/x.csv", "--markers": "FOLDER/x.csv", "--out": "FOLDER/b", "--atlas": "FOLDER/x",
        "--units": "cm",
    },
    "import": CUTS | {
        "--out": "FOLDER/b", "--body": "FOLDER/body.nii", "--ct": "FOLDER/ct.nii", "--tissue": "FOLDER/fat",
        "--labels": "totalsegmentator-v1", "--smoothing": "0.5", "--edge-length": "5", "--more-bones": "",
        "--posture": "prone",
    },
    "landmarks": {"--out": "FOLDER/b.csv", "--picture": "FOLDER/b.png"},
    "make-case": {
        "--skin": "FOLDER/x.ply", "--bones": "FOLDER/x", "--out": "FOLDER/b", "--curve": "double_major",
        "--cobb": "50", "--rotation": "9", "--kyphosis": "30", "--lumbar-rotation": "4",
        "--spine": "FOLDER/x.csv", "--direction": "left", "--correction": "0.5",
    },
    "cut": {
        "--bone": "T8", "--plane": "0 0 9 0 0 1", "--names": "upper lower", "--radius": "20",
    },
    "view": {"--web": ""},
    "report": {"--out": "FOLDER/other", "--views": "bare"},
    "measure": {
        "--case": "FOLDER/other", "--against": "FOLDER/x.ply", "--when": "before", "--spine": "FOLDER/line.csv",
        "--markers": "FOLDER/x.csv", "--units": "cm", "--out": "FOLDER/other",
    },
    "export": {"--out": "FOLDER/b.glb", "--glb": "", "--plain": ""},
}  # fmt: skip
BASE = {
    "simulate": "simulate FOLDER/case",
    "cohort": "cohort FOLDER --out FOLDER/out",
    "calibrate": "calibrate FOLDER --free epsilon --out FOLDER/out.toml --bones spline",
    "plan": "plan FOLDER/case --plan FOLDER/plan.toml --out FOLDER/out --predict",
    "demo": "demo",
    "doctor": "doctor",
    "close": "close FOLDER/1.ply FOLDER/2.ply --out FOLDER/a.ply",
    "triangulate": "triangulate --pa FOLDER/a.csv --pa-matrix FOLDER/a.txt --lateral FOLDER/b.csv "
    "--lateral-matrix FOLDER/b.txt --out FOLDER/a.csv",
    "register": "register --skin FOLDER/a.ply --on-skin FOLDER/a.csv --on-films FOLDER/b.csv --out FOLDER/a.ply",
    "fit-atlas": "fit-atlas --bones FOLDER/a --atlas FOLDER/a.csv --patient FOLDER/b.csv --out FOLDER/fit_a",
    "fit-back": "fit-back FOLDER/a.ply --spine FOLDER/a.csv --markers FOLDER/b.csv --out FOLDER/a",
    "import": "import FOLDER/a.nii --out FOLDER/a",
    "landmarks": "landmarks FOLDER/a --out FOLDER/a.csv",
    "make-case": "make-case --skin FOLDER/a.ply --bones FOLDER/a --out FOLDER/a",
    "cut": "cut FOLDER/case --bone T7 --plane 0 0 5 0 0 1 --names above below",
    "view": "view FOLDER/a",
    "report": "report FOLDER/a",
    "measure": "measure FOLDER/a.ply --case FOLDER/case",
    "export": "export FOLDER/a --out FOLDER/a.glb",
}
OWN_BASE = {
    ("measure", "--spine"): "measure FOLDER/back.csv",
    ("measure", "--markers"): "measure FOLDER/back.csv --spine FOLDER/line.csv",
    ("measure", "--units"): "measure FOLDER/back.csv --spine FOLDER/line.csv",
    ("export", "--glb"): "export FOLDER/a",
}
"""Of options that do not go with the others."""
WITH = {
    ("plan", "--aim"): "--within T8,correction=0.2..0.8", ("plan", "--within"): "--aim hump",
    ("plan", "--port"): "--live", ("fit-atlas", "--skin"): "--atlas-skin FOLDER/b.ply",
    ("fit-atlas", "--atlas-skin"): "--skin FOLDER/b.ply",
}  # fmt: skip
"""Options that stand beside another."""


@dataclass(frozen=True)
class Calibrated:
    """The part of a calibration that the command reads."""

    converged: bool = True
    left_out: dict[str, str] = field(default_factory=dict)


END = object()
"""The answer of a function that does the work: with its call all that was asked for is known."""
POINTS = np.arange(9.0).reshape(3, 3)
MARKS = Landmarks(("C7", "PSIS_left", "PSIS_right"), POINTS)
FIT = SimpleNamespace(bones={}, names=("a",), miss=np.ones(1), left_out=np.full(1, np.nan), own=(), depth={})
RESULT = SimpleNamespace(
    summary=SimpleNamespace(case="a"), skin_before="before", skin=SimpleNamespace(vertices=[])
)
ANSWERS: dict[Any, dict[str, Any]] = {
    surfaces: {
        "check_written": None, "read_stated": ("scan", None), "in_lps": "scan", "read_transform": "matrix",
        "moved": "moved scan", "check_parts": None, "align_parts": ({"1": "aligned"}, {}), "close_skin": END,
        "check_place": None, "read_bones": {}, "check_bones": None, "find_landmarks": END,
        "read_measured_spine": "spine", "refuse_case": None, "read_surface": "surface", "make_case": END,
        "surface_files": {"T7": Path("T7.ply"), "T8": Path("T8.ply")}, "check_file_names": None, "cut_bone": END,
    },
    films: {
        "check_place": None, "read_film": "film", "triangulate": END, "check_written": None,
        "read_landmarks": MARKS, "read_surface": "surface", "register_skin": END, "read_bones": {},
        "fit_atlas": FIT, "write_whole": None,
    },
    back: {
        "refuse_case": None, "read_back": (POINTS, None), "read_patient_spine": "spine", "read_landmarks": MARKS,
        "made_body": "body", "read_bones": {}, "read_surface": "surface", "atlas_body": "atlas", "fit_back": END,
    },
    import_case: {
        "refuse_case": None, "read_source": "source", "read_body": "body", "read_tissue": "tissue",
        "import_case": END,
    },
    label_skin: {"body_in_scan": "scanned body"},
    measure: {
        "skin_file": Path("skin.ply"), "refuse_case": None, "make_writable": None,
        "case_of_skin": (RESULT, None), "read_skin": "skin", "judged": END, "_read_back": POINTS,
        "_read_spine": POINTS, "read_landmarks": MARKS, "measure_back": END,
    },
    result: {
        "refuse_case": None, "check_place": None, "read_result": RESULT, "skin_glb": b"",
        "write_whole": None,
    },
    recording: {"view_result": 0},
    writing: {"write_report": Path("report.html"), "write_comparison": Path("plans.html")},
    doctor: {"examine": []},
    phantom: {"phantom_case": "phantom"},
    simulate_command: {"simulate": END, "patient_of": END},
    plan_command: {"simulate": END, "best_plan": END},
    opening: {"plan_live": END},
    cohort_command: {
        "work": END, "calibrate": Calibrated(), "write_calibration": END,
    },
}  # fmt: skip
"""The functions that commands call, and what they are given there."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case with an actual skin, whose landmarks after surgery are 3 mm aside, with files to name."""
    folder, whole = tmp_path_factory.mktemp("options"), coarse_phantom()
    bones = {name: whole.bones[name] for name in (*VERTEBRAE, *PELVIC_RING)}
    case = replace(whole, bones=bones)
    after = case.planned_landmarks
    aside = replace(case, landmarks_after=replace(after, points=after.points + 3.0), actual_skin=case.skin)
    write_case(folder / "case", aside)
    text = 'uiv = "T4"\nliv = "L1"\n[[curve]]\napex = "T8"\ncorrection = {}\n'
    for name, correction in (("plan", 0.4), ("other", 0.6)):
        (folder / f"{name}.toml").write_text(text.format(correction), encoding="utf-8")
    (folder / "tissue.toml").write_text("density = 950.0\n", encoding="utf-8")
    (folder / "motions.toml").write_text("[sternum]\ntranslation = [0.0, -1.0, 0.0]\n", encoding="utf-8")
    return folder


read_once = cache(read_checked_case)
"""Reading is most of the time of a command that then does nothing."""


@cache
def answers(folder: str) -> dict[str, list[str]]:
    """The answers to the commands that were given on a folder; most tests give one that others give too."""
    return {}


def in_full(value: Any) -> Any:
    """All that a record holds, where `repr` is a summary."""
    names = getattr(value, "__struct_fields__", None)
    if names is None and dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = [field.name for field in dataclasses.fields(value)]
    if names is not None:
        return type(value).__name__, {name: in_full(getattr(value, name)) for name in names}
    if isinstance(value, Mapping):
        return {key: in_full(held) for key, held in value.items()}
    if isinstance(value, (list, tuple)):
        return [in_full(held) for held in value]
    return sha256(value.tobytes()).hexdigest() if isinstance(value, np.ndarray) else value


@pytest.fixture
def asked(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[str], list[str]]:
    """The calls that a command makes for its work, in words, and the line in which it refuses."""
    calls: list[str] = []
    kept_answers = answers(str(folder))

    def recorded(name: str, answer: Any) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            named.pop("progress", None)
            words = map(repr, map(in_full, (*arguments, *named.items())))
            shown = [word for word in words if "Progress" not in word]
            calls.append(f"{name}: {shown}")
            if answer is END:
                raise InputError("asked")
            return answer

        return call

    @contextmanager
    def connected(*arguments: Any) -> Iterator[SimpleNamespace]:
        calls.append(f"connected: {arguments}")
        yield SimpleNamespace(dashboard_link="")

    for module, functions in ANSWERS.items():
        for name, answer in functions.items():
            monkeypatch.setattr(module, name, recorded(name, answer))
    for module in (simulate_command, plan_command, cohort_command):
        monkeypatch.setattr(module, "read_checked_case", read_once)
    monkeypatch.setattr(plan_command, "write_planned_case", lambda _, case, surgery: surgery.planned_case(case))
    monkeypatch.setattr(cohort_command, "dask_client", connected)

    def run(words: str) -> list[str]:
        if words in kept_answers:
            return kept_answers[words]
        calls.clear()
        main(words.replace("FOLDER", str(folder)).split())
        refusals = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warp-trunk:")]
        return kept_answers.setdefault(words, [*calls, *refusals])

    return run


def test_every_command_is_in_the_table() -> None:
    assert TABLE.keys() == BASE.keys() == COMMANDS.keys()


@pytest.mark.parametrize("command", TABLE)
def test_every_option_is_in_the_table(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([command, "--help-all"])
    rows = [line.strip("│ ") for line in capsys.readouterr().out.splitlines()]
    flags = [row.split("  ")[0].split(", ") for row in rows if row.startswith("--")]
    flags = [[word.split()[0] for word in words] for words in flags]
    flags = [words for words in flags if re.fullmatch(r"--\w[\w-]*", words[0])]
    assert flags
    lacking = [words for words in flags if not TABLE[command].keys() & {*words}]
    assert lacking == []
    assert [flag for flag in TABLE[command] if not any(flag in words for words in flags)] == []


def test_several_results_are_bare_side_by_side_where_that_is_asked_for(asked: Callable[[str], list[str]]) -> None:
    assert asked("report FOLDER/a FOLDER/b") != asked("report FOLDER/a FOLDER/b --views bare")


def of_simulation(command: str, flag: str) -> bool:
    """Whether a field of `RunOptions` or `Execution` takes the option; several cases have no mesh of their own."""
    of_one_case = flag in ("--from-mesh", "--view") and command in ("cohort", "calibrate")
    return flag in {*SIMULATION, "--no-bands"} and not of_one_case


@pytest.mark.parametrize("command", ["simulate", "cohort", "calibrate", "plan", "demo"])
def test_each_option_of_a_simulation_changes_its_own_field(
    command: str, asked: Callable[[str], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """All are given at once, as each command that simulates has them."""
    for module in (cohort_command, one_case):
        monkeypatch.setattr(module, "refuse_unread", lambda *_: None)
    monkeypatch.setattr(cohort_command, "check_free", lambda *_: None)
    flags = {flag: value for flag, value in TABLE[command].items() if of_simulation(command, flag)}
    base = BASE[command].replace("--bones spline", "")
    without = " ".join(asked(base))
    for group in ([flag for flag in flags if flag != "--no-record"], ["--no-record"]):  # which is not for --view
        asked_with = " ".join(asked(" ".join([base, *(f"{flag} {flags[flag]}" for flag in group)])))
        for flag in group:
            name = flag.removeprefix("--").removeprefix("no-").replace("-", "_")
            before, after = (re.findall(rf"'{name}': ([^,}}]+)", text) for text in (without, asked_with))
            assert len(before) == len(after) > 0, (flag, asked_with[:300])
            assert before != after, flag


OWN_OPTIONS = [(name, flag) for name, flags in TABLE.items() for flag in flags if not of_simulation(name, flag)]


@pytest.mark.parametrize(("command", "flag"), OWN_OPTIONS)
def test_with_an_option_something_else_is_asked_for(
    command: str, flag: str, asked: Callable[[str], list[str]]
) -> None:
    value, words = TABLE[command][flag], OWN_BASE.get((command, flag), BASE[command]).split()
    if "--live" in (flag, WITH.get((command, flag))):
        words.remove("--predict")
    rest = words
    if flag in words:
        place = words.index(flag)
        rest = words[:place] + words[place + 1 + len(value.split()) :]
    beside = WITH.get((command, flag), "")
    without = asked(" ".join([*(words if value else rest), beside]))
    assert without or not value
    assert asked(" ".join([*rest, beside, flag, value])) != without
