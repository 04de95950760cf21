"""The words that commands print and the texts that they write, compared with accepted ones."""

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import warp_trunk.cli.back as back_command
import warp_trunk.cli.cohort as cohort_command
import warp_trunk.cli.plan as plan_command
import warp_trunk.cli.simulate as simulate_command
from support.biplanar import biplanar, write_films
from support.blocks import VERTEBRA, blocks, moved, spine_and_hips
from support.console import Console
from support.known_patient import ACTUAL, known_case, write_known_result
from support.known_spine import known_spine
from support.phantoms import coarse_phantom
from support.report_results import write_small_result
from support.shown import check_shown, described
from support.small_case import palpated, part_case, small_case
from support.synthetic import sphere
from warp_trunk.bone_motion.plan import CurvePlan, Plan, read_plan
from warp_trunk.case import read_case, read_checked_case, write_case
from warp_trunk.case.anatomy import PELVIC_RING, VERTEBRAE
from warp_trunk.case.landmarks import Landmarks, read_landmarks, write_landmarks
from warp_trunk.case.motions import Motion
from warp_trunk.cli import doctor, films, import_case, surfaces
from warp_trunk.cli.back import fused
from warp_trunk.cohort import cohort_page
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.geometry.cutting import CutPlane
from warp_trunk.io.surface_files import read_surface, write_surface
from warp_trunk.live import opening
from warp_trunk.preparation import phantom
from warp_trunk.preparation.deformity.spine_curve import MeasuredSpine
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.recording import viewer
from warp_trunk.report import landmark_picture, scan_pictures, writing
from warp_trunk.results import read_result
from warp_trunk.run.doctor import Finding
from warp_trunk.spine import CobbAngle

FINDINGS = [
    Finding("processor", "x86_64", needed=True), Finding("display", "none", "use --web"),
    Finding("kernels", "broken", "install it", needed=True),
]  # fmt: skip
FORWARD = Motion(translation=(0.0, -1.0, 0.0))
SPINES = {
    "large": {"T4": -20.0, "T11": 18.0, "L5": 2.0},
    "small": {"T4": -12.0, "T11": 12.0, "L5": 2.0},
    "none": {},
}

SPINE_BONES = (*VERTEBRAE, *PELVIC_RING, "sternum")


@pytest.fixture(scope="module")
def plannable(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a case of a few bones, whose spine is whole, and a plan."""
    folder, whole = tmp_path_factory.mktemp("plannable"), coarse_phantom()
    bones = {name: bone for name, bone in whole.bones.items() if name in SPINE_BONES}
    write_case(folder / "case", replace(whole, bones=bones, landmarks_after=None))
    loose_bones = {name: bone for name, bone in bones.items() if name not in PELVIC_RING}
    write_case(
        folder / "loose", replace(palpated(replace(whole, bones=bones)), bones=loose_bones, landmarks_after=None)
    )
    write_case(folder / "parts", part_case(front=FORWARD))
    for name, correction in (("a", 0.65), ("b", 0.5)):
        text = f'uiv = "T4"\nliv = "L1"\n[[curve]]\napex = "T8"\ncorrection = {correction}\nderotation = 0.4\n'
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    return folder


def test_doctor(console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    for findings in (FINDINGS[:1], FINDINGS[:2], FINDINGS, FINDINGS[2:0:-1]):
        monkeypatch.setattr(doctor, "examine", lambda _, findings=findings: findings)
        console.run("doctor")

    def interrupted(_: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(doctor, "examine", interrupted)
    console.run("doctor")
    check_shown("console_doctor", console.lines)


def test_what_becomes_of_surfaces_is_as_accepted(console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    """A ball of 20 mm, cut 10 mm above its middle, where a cap of 5/32 of its volume is; in mm and in cm."""
    for units, size in (("mm", 1.0), ("cm", 10.0)):
        bones = Path(units) / "bones"
        bones.mkdir(parents=True)
        write_surface(bones / "T7.ply", sphere(20.0 / size))
        Path(units, "case.toml").write_text(f'units = "{units}"\n', encoding="utf-8")
        console.run(f"cut {units} --bone T7 --plane 0 0 10 0 0 1 --names below above")
        above, below = (read_surface(bones / f"{name}.ply").vertices[:, 2] for name in ("above", "below"))
        assert (above.min(), below.max()) == pytest.approx((10.0 / size, 10.0 / size), abs=1e-3)
        write_surface(bones / "T7.ply", sphere(20.0 / size))  # a part of that name is cut again
        console.run(f"cut {units} --bone T7 --plane 0 0 0 0 0 1 --names low middle")
        names = ["above.ply", "below.ply", "low.ply", "middle.ply"]
        assert sorted(path.name for path in bones.iterdir()) == names
        assert (Path(units) / "bones_uncut" / "T7.ply").is_file()
    write_surface("mm/bones/T8.ply", sphere(20.0, (5.0, 0.0, 0.0)), "RAS")  # in which it lies to the right
    console.run("cut mm --bone T8 --plane -5 0 0 1 0 0 --names right left --radius 100")
    assert read_surface("mm/bones/right.ply").vertices[:, 0].max() == pytest.approx(-5.0, abs=1e-3)
    openings = [
        SimpleNamespace(is_end=is_end, area=area, centre=np.array([1.0, -2.0, 3.0]))
        for is_end, area in ((True, 25_000.0), (False, 130.0))
    ]
    by, asked = SimpleNamespace(shift=1.25, turn=2.5, distance=0.75), list[Any]()
    monkeypatch.setattr(surfaces, "align_parts", lambda parts: (parts, {"front": by}))
    closed = SimpleNamespace(surface=sphere(10.0), openings=openings)

    def close(parts: Any, *_: object) -> Any:
        asked.append(parts)
        return closed

    monkeypatch.setattr(surfaces, "close_skin", close)
    write_surface("a.ply", sphere(200.0), "RAS")
    write_surface("b.ply", sphere(210.0), None)
    Path("a.txt").write_text("1 0 0 5\n0 1 0 6\n0 0 1 7\n0 0 0 1\n", encoding="utf-8")
    Path("b.txt").write_text("1 0 0 0\n0 1 0 0\n0 0 1 1\n0 0 0 1\n", encoding="utf-8")
    console.run("close a.ply b.ply --out skin.ply --refine --transforms a.txt b.txt")
    middles = [part.vertices.mean(axis=0) for part in asked[0].values()]
    np.testing.assert_allclose(middles, [[5.0, 6.0, 7.0], [0.0, 0.0, 1.0]], atol=1e-9)
    assert b"SPACE=LPS" in Path("skin.ply").read_bytes()[:300]
    console.run("close b.ply --out other.ply")
    assert b"SPACE" not in Path("other.ply").read_bytes()[:300]
    check_shown("console_surfaces", console.lines)


def test_what_films_and_an_atlas_give_is_as_accepted(console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    skin, bones, marks = straight_trunk()
    first, second = biplanar(marks)
    number = np.arange(len(marks.names))[:, None]
    off = first.points + [0.0, 0.1] * np.sin(number)  # along the spine, which both films see
    off[7] += [0.0, 3.0]
    words = write_films(Path(), (replace(first, points=off), second))
    for more in ((), ("--noise", 0.5, "--limit", 3)):
        console.run(["triangulate", *words, "--out", "landmarks.csv", *more])
    missed = np.linalg.norm(read_landmarks("landmarks.csv").points - marks.points, axis=1)
    assert (missed < 2.0).all()
    rows = np.arange(0, len(skin.vertices), len(skin.vertices) // 20)
    names = tuple(f"marker_{i}" for i in range(len(rows)))
    write_surface("scan.ply", skin)
    write_landmarks("skin.csv", Landmarks(names, skin.vertices[rows]))
    targets = skin.vertices[rows] + [5.0, -80.0, 2.0] + np.sin(number[: len(rows)] * [1, 2, 3])
    write_landmarks("films.csv", Landmarks(names, targets))
    console.run("register --skin scan.ply --on-skin skin.csv --on-films films.csv --out skin.ply --nugget 9")
    moved_by = read_surface("skin.ply").vertices - skin.vertices
    np.testing.assert_allclose(moved_by, np.tile([5.0, -80.0, 2.0], (len(moved_by), 1)), atol=3.0)
    size, place = np.array([1.02, 1.04, 1.1]), np.array([3.0, -7.0, 20.0])  # which a linear drift takes up
    write_landmarks("atlas.csv", marks)
    write_landmarks(
        "patient.csv", Landmarks(marks.names, marks.points * size + place + np.sin(number * [1, 2, 3]))
    )
    Path("bones").mkdir()
    for name in ("T7", "rib_left_08"):
        write_surface(f"bones/{name}.ply", bones[name])
    words = "fit-atlas --bones bones --atlas atlas.csv --patient patient.csv --out new/bones"
    console.run(f"{words} --nugget 20")
    for name in ("T7", "rib_left_08"):
        carried = read_surface(f"new/bones/{name}.ply").vertices
        np.testing.assert_allclose(carried, bones[name].vertices * size + place, atol=4.0)
    errors = {"miss": np.array([1.0, 3.0]), "left_out": np.array([2.0, 6.0]), "own": ("T7",), "names": ("a", "b")}
    for depth in ({"rib_left_08": 4.0, "sternum": 2.5}, {"rib_left_08": -0.5, "sternum": 2.5}, {}):
        fit = SimpleNamespace(bones={"T7": sphere(10.0), "T8": sphere(9.0)}, depth=depth, **errors)
        monkeypatch.setattr(films, "fit_atlas", lambda *_, fit=fit, **__: fit)
        console.run(words)
    console.file("new/bones/atlas_fit.csv")
    check_shown("console_films", console.lines)


def test_what_is_found_on_bones_is_as_accepted(console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    """At first T6 has one pedicle, so it has no landmarks."""
    monkeypatch.setattr(landmark_picture, "landmark_picture", lambda *_: b"picture")
    Path("case/bones").mkdir(parents=True)
    Path("case/case.toml").write_text("", encoding="utf-8")
    bones = {name: spine_and_hips()[name] for name in ("T5", "T6", "T7", "hip_left", "hip_right")}
    shape = moved(blocks((*VERTEBRA[:2], *VERTEBRA[3:])), 0.8 * np.eye(3), [0.0, 50.0, 340.0])
    for name, bone in (bones | {"T6": shape}).items():
        write_surface(f"case/bones/{name}.ply", bone)
    console.run("landmarks case --out case/landmarks_before.csv")
    assert read_landmarks("case/landmarks_before.csv").vertebrae() == ("T5", "T7")
    write_surface("case/bones/T6.ply", bones["T6"])
    console.run("landmarks case/bones --out case/landmarks_before.csv --picture found.png")
    assert Path("found.png").read_bytes() == b"picture"
    console.file("case/case.toml")
    check_shown("console_landmarks", console.lines)


def test_what_an_image_gives_is_as_accepted(console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(landmark_picture, "landmark_picture", lambda *_: b"picture")
    names = [f"label {n}" for n in range(14)]
    source: Any = SimpleNamespace(ignored=names[:2], empty=["T1"])
    monkeypatch.setattr(import_case, "read_source", lambda *_: source)
    vertebra = SimpleNamespace(asymmetry=0.426, off_curve=3.26, height=17.04)
    whole = coarse_phantom()
    few = replace(whole, notes=("A note.",), bones={n: b for n, b in whole.bones.items() if n in SPINE_BONES})
    made: Any = SimpleNamespace(
        case=few, landmarks=SimpleNamespace(vertebrae={"T8": vertebra}, unsure={}), cuts=(), fat=None,
        notes=("A note.",),
        shapes={"T8": SimpleNamespace(change=0.01), "T9": SimpleNamespace(change=-0.0234)},
    )  # fmt: skip
    monkeypatch.setattr(import_case, "import_case", lambda *_, **__: made)
    console.run("import map.nii --out a")
    console.file("a/landmarks_confidence.csv")
    assert Path("a/landmarks_before.png").read_bytes() == b"picture"
    assert len(read_case("a").bones) == len(SPINE_BONES)
    source.ignored, source.empty, made.shapes = names, (), {}
    made.fat, made.cuts = np.arange(101.0), (CutPlane((0.0, 0.0, 480.0), (0.0, 0.0, 1.0)),)
    made.landmarks.unsure = {"T6": "no canal"}
    made.case = replace(few, posture="prone", landmarks_after=None)
    console.run("import map.nii --out b --posture prone")
    made.landmarks.vertebrae, made.landmarks.unsure = {}, {}
    marks = few.landmarks_before
    made.case = replace(few, landmarks_before=Landmarks(marks.names[:6], marks.points[:6]), landmarks_after=None)
    console.run("import map.nii --out c")
    assert not Path("c/landmarks_before.png").exists()
    examples = [import_case._example(levels) for levels in (VERTEBRAE, VERTEBRAE[12:], VERTEBRAE[8:12], ())]
    check_shown("console_import", [*console.lines, *map(str, examples)])


def test_what_a_scan_of_a_back_gives_is_as_accepted(console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scan_pictures, "fit_picture", lambda _: b"picture")
    fit: Any = SimpleNamespace(
        distance=np.array([0.5, 1.5]), forward=np.eye(17)[2] * 4.0, body="the body", scale=0.925, left_out=[0] * 6,
        scan=SimpleNamespace(noise=0.5), invented=0.625, moved=np.array([-6.0, 8.0, 0.5]),
    )  # fmt: skip
    monkeypatch.setattr(back_command, "read_back", lambda *_: (np.eye(3), None))
    monkeypatch.setattr(back_command, "read_patient_spine", lambda *_: spine)
    monkeypatch.setattr(back_command, "read_landmarks", lambda _: Landmarks(("C7",), np.eye(3)[:1]))
    monkeypatch.setattr(back_command, "made_body", lambda: "body")
    monkeypatch.setattr(back_command, "fit_back", lambda *_, **__: fit)
    spine: Any = SimpleNamespace()
    for spine.kind, (name, tilts) in zip(("line", "pedicles", "landmarks"), SPINES.items(), strict=True):
        fit.case = replace(part_case(), landmarks_before=known_spine(tilts))
        console.run(f"fit-back back.xyz --spine spine.csv --markers markers.csv --out {name}")
        assert Path(name, "fit.png").read_bytes() == b"picture"
        fit.scan.noise, fit.forward, fit.moved = 9.0, 0.1 * fit.forward, 0.4 * fit.moved
    ends = [f"{apex}: {fused(CobbAngle(30.0, 'upper', 'lower', apex, 'left'))}" for apex in VERTEBRAE]
    check_shown("console_back", [*console.lines, *ends])


def test_a_case_that_is_made(console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    spine = MeasuredSpine(
        name="mine", tilt=np.zeros(17), pitch=np.zeros(17), turn=np.zeros(17), continued=("T1", "T2", "T3")
    )
    monkeypatch.setattr(surfaces, "read_measured_spine", lambda _: spine)
    monkeypatch.setattr(surfaces, "read_bones", lambda _: {})
    monkeypatch.setattr(surfaces, "read_surface", lambda _: None)
    monkeypatch.setattr(surfaces, "make_case", lambda *_: part_case())
    files = "make-case --skin skin --bones bones"
    console.run(f"{files} --spine spine.csv --out a")
    console.run(f"{files} --out b --curve double_major --cobb 45 --direction left")
    console.run(f"{files} --out c --cobb 0 --correction 1.0")
    console.file("a/case.toml")
    check_shown("console_make_case", console.lines)


def test_what_a_plan_gives_is_as_accepted(
    plannable: Path, console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The option takes the place of what the file states, and a plan that was written makes it again."""
    for name in ("case", "loose", "parts", "a.toml"):
        Path(name).symlink_to(plannable / name)
    monkeypatch.setattr(plan_command, "read_checked_case", cache(read_checked_case))
    ends = "--uiv T3 --liv L2 --curve T8,cobb_after=25 --kyphosis-T5-T12 30"
    for words in (
        "case --out planned --plan a.toml", "case --out planned --plan a.toml --liv L2",
        f"case --out first {ends}", "case --out again --plan first/plan.toml",
        "case --out still --uiv T4 --liv L1", "case", "case --out case", "case --out no --uiv T4",
        "case --out no --uiv T4 --liv L1 --curve T8,correctoin=0.5",
        "case --live --aim hump --within T8,correction=0..1",
        "case --out no --uiv T4 --liv L1 --curve T8,correction=0.5,correction=0.6",
        "case --out no --plan a.toml --aim hump", "case --out no --plan a.toml --within T8,correction=0..1",
        "case --out no --plan a.toml --aim bsr --within T8,correction=0.5", "parts --out no --uiv T4 --liv L1",
        "loose --out no --plan a.toml", "case --live --predict", "case --live --port 0",
        "parts --live --uiv T4",
    ):  # fmt: skip
        console.run(f"plan {words}")
    first, again = (read_case(name).planned_landmarks.points for name in ("first", "again"))
    np.testing.assert_array_equal(again, first)
    before, after = (read_case("planned").landmarks_before, read_case("planned").planned_landmarks)
    t8 = json.loads(Path("planned/plan.json").read_text(encoding="utf-8"))["vertebrae"][7]
    middles = [marks.of_bone("T8").points.mean(axis=0) for marks in (before, after)]
    np.testing.assert_allclose(t8["shift"], middles[1] - middles[0], atol=1e-9)
    assert not Path("no").exists()
    console.file("planned/plan.toml")
    best = replace(read_plan("a.toml"), curves=(CurvePlan("T8", correction=0.7),))
    monkeypatch.setattr(plan_command, "best_plan", lambda *_, **__: SimpleNamespace(plan=best))
    monkeypatch.setattr(plan_command, "best_plan_text", lambda _: "The best plan.")
    console.run("plan case --plan a.toml --aim hump --within T8,correction=0.2..0.8 --out best")
    console.file("best/plan.toml")
    monkeypatch.setattr(opening, "find_spec", lambda name: None if name == "viser" else name)
    for name in ("case", "parts"):
        console.run(f"plan {name} --live")
    check_shown("console_plan", console.lines)


def test_what_a_simulation_gives_is_as_accepted(
    plannable: Path, console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One plan that did not converge gives its status to all; the demo is the operation that its help states."""
    for name in ("parts", "a.toml", "b.toml"):
        Path(name).symlink_to(plannable / name)
    ends = {"a": RelaxStatus.CONVERGED, "b": RelaxStatus.STALLED, "": RelaxStatus.CONVERGED}
    asked = list[str]()

    def simulated(case: Any, plans: Any, options: Any, *_: Any, folder: Path, **more: Any) -> Any:
        if isinstance(plans, Plan):
            asked.extend(described(value) for value in (case, plans.uiv, plans.liv, str(plans.curves[0])))
            asked.append(
                f"{options.mesh} {options.simulation.increments} {options.bands} {folder} {more['warnings']}"
            )
        results = {}
        for name in plans if isinstance(plans, dict) else ("",):
            write_small_result(folder / name, status=ends[name])
            if name != "b":
                (folder / name / "recording.rrd").write_bytes(b"")
            results[name] = read_result(folder / name)
            if name:
                more["progress"].result(name, results[name])
        return results.get("")

    monkeypatch.setattr(simulate_command, "simulate", simulated)
    monkeypatch.setattr(phantom, "phantom_case", lambda: "phantom")
    console.run("simulate parts --out one")
    console.run("simulate parts --plan b.toml --plan a.toml --out two")
    console.run("simulate parts --plan a.toml")
    console.run("demo")
    check_shown("console_simulate", [*console.lines, *asked])


def test_what_results_give_is_as_accepted(console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    case = known_case(actual=ACTUAL)[0]
    assert case.actual_skin is not None
    write_surface("actual.ply", case.actual_skin)
    write_known_result(Path("result"))
    started = list[list[str]]()

    def run(command: list[str], **_: object) -> Any:
        started.append(command)
        return SimpleNamespace(returncode=0)

    monkeypatch.setattr(writing, "write_report", lambda *_, **__: Path("result/report.html"))
    monkeypatch.setattr(writing, "write_comparison", lambda *_, **__: Path("result/plans.html"))
    console.run("measure result --against actual.ply --out table")
    for name in ("mesh.vtu", "skin.glb"):
        console.run(f"export result --out {name}")
    console.run("export result --glb")
    console.run("report result")
    console.run("report result result")
    console.run("view result")
    Path("result/recording.rrd").write_bytes(b"")
    monkeypatch.setattr(viewer, "subprocess", SimpleNamespace(run=run))  # Warp asks loose_bones of the machine
    monkeypatch.setenv("DISPLAY", ":0")
    console.run("view result")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    console.run("view result")
    (command,) = started
    assert command[1:] == ["-m", "rerun", "--bind", "127.0.0.1", "result/recording.rrd"]  # for this machine only
    check_shown("console_results", console.lines)


@dataclass(frozen=True)
class Calibrated:
    """The part of a calibration that the command reads."""

    converged: bool = True
    left_out: dict[str, str] = field(default_factory=dict)


def test_what_many_cases_give_is_as_accepted(console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    """A case that cannot be read is named among the loose_bones, as is one that has no actual skin."""
    good = replace(small_case(), name="small", tissue=Tissue(), actual_skin=small_case().skin)
    for name, case in {"a": good, "b": replace(good, actual_skin=None)}.items():
        write_case(Path("cases") / name, case)
    write_case("cases/c", replace(part_case(front=FORWARD), actual_skin=part_case().skin))
    shutil.copytree("cases/a", "cases/0")
    Path("cases/0/skin.ply").unlink()  # the first of them
    Path("out/old").mkdir(parents=True)
    Path("out/old/summary.json").touch()

    @contextmanager
    def connected(*_: object) -> Iterator[SimpleNamespace]:
        yield SimpleNamespace(dashboard_link="LINK")

    done, summary = Calibrated(), SimpleNamespace(complete=False)
    monkeypatch.setattr(cohort_command, "dask_client", connected)
    monkeypatch.setattr(cohort_command, "calibrate", lambda _, jobs, free, *more, **named: done)
    monkeypatch.setattr(cohort_command, "write_calibration", lambda *_: "page.html")
    monkeypatch.setattr(cohort_command, "calibration_text", lambda made: f"left out: {made.left_out}")
    monkeypatch.setattr(cohort_command, "work", lambda *_: [])
    monkeypatch.setattr(cohort_page, "write_cohort", lambda *_: summary)
    monkeypatch.setattr(cohort_page, "cohort_text", lambda _: "The cohort.")
    console.run("cohort cases --out out")
    summary.complete = True
    console.run("cohort cases --out out")
    for words in ("theta", "density", "theta --pose bending", "theta --poisson-ratio 0.3"):
        console.run(f"calibrate cases --free {words} --energy itmsm --out a.toml")
    shutil.rmtree("cases/0")
    console.run("calibrate cases --free theta --energy itmsm --out a.toml")
    check_shown("console_cohort", console.lines)
