"""The words that commands print: places, volumes, findings, interruptions; and the plan of the demo."""

import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import warp_trunk.cli.simulate as simulate_command
from support.known_patient import ACTUAL, known_case, write_known_result
from support.shown import check_shown
from support.small_case import part_case
from support.synthetic import sphere
from warp_trunk.case.landmarks import Landmarks, write_landmarks
from warp_trunk.cli import doctor, films, main, surfaces
from warp_trunk.cli.back import fit_text
from warp_trunk.cli.output import BAD_INPUT, INCOMPLETE, INTERRUPTED, OK
from warp_trunk.cli.simulate import crossings_written
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface_checks import enclosed_volume
from warp_trunk.io.surface_files import read_surface, write_surface
from warp_trunk.measures.back import TURN
from warp_trunk.meshing import CrossingError
from warp_trunk.preparation import phantom
from warp_trunk.preparation.back_scan.spine import TURN_SD
from warp_trunk.preparation.deformity.spine_curve import MeasuredSpine
from warp_trunk.run.doctor import Finding

MISSING = Finding("kernels", "broken", "install it", needed=True)
NOTE = Finding("display", "none", "use --web")
FINE = Finding("processor", "x86_64", needed=True)


@pytest.mark.parametrize(
    ("findings", "status", "marks"),
    [
        ([FINE], OK, ["ok"]),
        ([FINE, NOTE], OK, ["ok", "note"]),
        ([MISSING, FINE], INCOMPLETE, ["MISSING", "ok"]),
        ([NOTE, MISSING], INCOMPLETE, ["note", "MISSING"]),
    ],
)
def test_doctor_ends_as_its_marks_say(
    findings: list[Finding],
    status: int,
    marks: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(doctor, "examine", lambda _: findings)
    assert main(["doctor"]) == status
    said = capsys.readouterr().out
    assert re.findall(r"^(ok|note|MISSING) ", said, re.MULTILINE) == marks
    assert [line.split("-> ")[1] for line in said.splitlines() if "-> " in line] == [
        part.cure for part in findings if part.cure
    ]
    assert said.rstrip().endswith("Ready." if status == OK else "see the lines marked MISSING.")


def test_an_interruption_has_its_status_and_says_so_where_errors_stand(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(_: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(doctor, "examine", interrupted)
    assert main(["doctor"]) == INTERRUPTED
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "warp-trunk: interrupted\n")


@pytest.mark.parametrize(("units", "size"), [("mm", 1.0), ("cm", 10.0)])
def test_parts_of_a_bone_have_their_volumes_and_their_sides(
    units: str, size: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A ball of 20 mm, cut 10 mm above its middle: a cap of 5/32 of its volume is beyond."""
    ball = sphere(20.0 / size)
    (tmp_path / "bones").mkdir()
    write_surface(tmp_path / "bones" / "T7.ply", ball)
    (tmp_path / "case.toml").write_text(f'units = "{units}"\n', encoding="utf-8")
    plane = ["0", "0", "10", "0", "0", "1"]
    assert main(["cut", str(tmp_path), "--bone", "T7", "--plane", *plane, "--names", "below", "above"]) == OK
    said = dict(re.findall(r"^(\w+): ([\d.]+) cm3$", capsys.readouterr().out, re.MULTILINE))
    whole = 4.0 / 3.0 * np.pi * 8.0
    assert float(said["above"]) == pytest.approx(5.0 / 32.0 * whole, rel=0.03)
    assert float(said["below"]) == pytest.approx(27.0 / 32.0 * whole, rel=0.03)
    above, below = (read_surface(tmp_path / "bones" / f"{name}.ply") for name in ("above", "below"))
    assert above.vertices[:, 2].min() == pytest.approx(10.0 / size, abs=1e-3)
    assert below.vertices[:, 2].max() == pytest.approx(10.0 / size, abs=1e-3)
    assert enclosed_volume(above) * size**3 / 1000.0 == pytest.approx(float(said["above"]), abs=0.01)
    assert (tmp_path / "bones_uncut" / "T7.ply").is_file()
    assert sorted(path.name for path in (tmp_path / "bones").iterdir()) == ["above.ply", "below.ply"]
    write_surface(tmp_path / "bones" / "T7.ply", below)  # a part of that name is cut again
    plane = ["0", "0", "0", "0", "0", "1"]
    assert main(["cut", str(tmp_path), "--bone", "T7", "--plane", *plane, "--names", "low", "middle"]) == OK
    parts = ["above.ply", "below.ply", "low.ply", "middle.ply"]
    assert sorted(path.name for path in (tmp_path / "bones").iterdir()) == parts


def test_bones_with_names_that_are_nearly_right_are_refused_by_commands_that_read_them(
    tmp_path: Path, refused: Callable[..., str]
) -> None:
    write_surface(tmp_path / "T08.ply", sphere(10.0))
    refused(["landmarks", tmp_path, "--out", tmp_path / "a.csv"], "T08", "a case calls this bone T8")


@pytest.mark.parametrize(
    ("depth", "words"),
    [
        ({"rib_left_08": 4.0, "sternum": 2.5}, "Nearest to the skin comes sternum, 2.5 mm under it"),
        ({"rib_left_08": -0.5, "sternum": 2.5}, "Nearest to the skin comes rib_left_08, 0.5 mm outside it"),
        ({}, "Ribs and sternum are not fitted under a skin: give --skin and --atlas-skin for that"),
    ],
)
def test_fit_atlas_says_which_bone_comes_nearest_to_the_skin_and_from_where(
    depth: dict[str, float],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    fit = SimpleNamespace(
        bones={"T7": sphere(10.0)}, names=("a", "b"), miss=np.array([1.0, 3.0]), left_out=np.array([2.0, 6.0]),
        own=("T7",), depth=depth,
    )  # fmt: skip
    asked: list[Any] = []
    monkeypatch.setattr(films, "fit_atlas", lambda *arguments, **_: asked.append(arguments) or fit)
    (tmp_path / "atlas").mkdir()
    write_surface(tmp_path / "atlas" / "T7.ply", sphere(10.0))
    for name, x in (("a", 0.0), ("p", 1.0)):
        write_landmarks(tmp_path / f"{name}.csv", Landmarks(("a", "b"), np.array([[x, 0.0, 0.0], [x, 9.0, 0.0]])))
    files = ["--atlas", str(tmp_path / "a.csv"), "--patient", str(tmp_path / "p.csv")]
    words_of_command = ["fit-atlas", "--bones", str(tmp_path / "atlas"), *files, "--out", str(tmp_path / "out")]
    assert main(words_of_command) == OK
    said = capsys.readouterr().out
    assert words in said
    assert "Landmarks are missed by mean 2.00, largest 3.00 mm (b)" in said
    assert "Left out one at a time: mean 4.00, largest 6.00 mm (b)" in said
    ((_, atlas, patient, drift, nugget),) = asked
    assert (atlas.points[0, 0], patient.points[0, 0], drift, nugget) == (0.0, 1.0, "linear", 0.0)
    rows = (tmp_path / "out" / "atlas_fit.csv").read_text(encoding="utf-8").split()
    assert rows == ["name,error,error_left_out", "a,1.0,2.0", "b,3.0,6.0"]
    assert (tmp_path / "out" / "T7.ply").is_file()


def test_close_says_what_it_closed_and_writes_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    openings = [
        SimpleNamespace(is_end=is_end, area=area, centre=np.array([1.0, -2.0, 3.0]))
        for is_end, area in ((True, 25_000.0), (False, 130.0))
    ]
    closed = SimpleNamespace(surface=sphere(10.0), openings=openings)
    by = SimpleNamespace(shift=1.25, turn=2.5, distance=0.75)
    monkeypatch.setattr(surfaces, "align_parts", lambda parts: (parts, {"front": by}))
    monkeypatch.setattr(surfaces, "close_skin", lambda *_: closed)
    write_surface(tmp_path / "a.ply", sphere(200.0))
    out = tmp_path / "skin.ply"
    assert main(["close", str(tmp_path / "a.ply"), "--out", str(out), "--refine"]) == OK
    assert capsys.readouterr().out.splitlines() == [
        "front: moved by 1.25 mm and 2.50 degrees, now 0.75 mm from the others",
        "Closed: end, flat, 250.0 cm2 at (1, -2, 3) mm",
        "Closed: hole, 1.3 cm2 at (1, -2, 3) mm",
        f"Closed skin of {len(closed.surface.faces)} triangles written to {out}",
    ]
    assert len(read_surface(out).faces) == len(closed.surface.faces)


def test_fit_back_says_what_is_measured_what_is_invented_and_what_went_where() -> None:
    scan = SimpleNamespace(noise=0.5)
    fit: Any = SimpleNamespace(
        distance=np.array([0.5, 1.5]), forward=np.eye(17)[2] * 4.0, body="the body", scale=0.925, left_out=[0] * 6,
        scan=scan, invented=0.625, moved=np.array([-6.0, 8.0, 0.5]),
    )  # fmt: skip
    lines = fit_text(fit, "line").splitlines()
    assert lines == [
        "Fitted the body, scaled by 0.93: 2 points of the trunk, mean 1.00 mm, 95 % nearer than 1.45 mm, "
        "largest 1.5 mm",
        "Left out 6 of 8 points: surroundings, arms, hair, clothes, stray points",
        "The points of the scan scatter by 0.5 mm about the skin",
        "Invented: 62 % of the skin, the ribs, the pelvis but for its turn",
        f"Turn of the vertebrae: {TURN:g} degrees for each mm of sideways way, ±{TURN_SD['line']:g} degrees",
        "Vertebrae went forward to lie under the skin, T3 by 4 mm",
        "The pelvis went -6 mm to the left, +8 back and +0 up, to lie under L5",
    ]
    scan.noise, fit.forward, fit.moved = 9.0, 0.1 * fit.forward, 0.4 * fit.moved
    noisy = fit_text(fit, "line").splitlines()
    assert noisy[2] == "The points of the scan scatter by 9 mm about the skin, so they were smoothed"
    assert len(noisy) == 5


def test_make_case_names_the_levels_at_which_a_measured_curve_fades_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    spine = MeasuredSpine(
        name="mine", tilt=np.zeros(17), pitch=np.zeros(17), turn=np.zeros(17), continued=("T1", "T2", "T3")
    )
    monkeypatch.setattr(surfaces, "read_measured_spine", lambda _: spine)
    monkeypatch.setattr(surfaces, "read_bones", lambda _: {})
    monkeypatch.setattr(surfaces, "read_surface", lambda _: None)
    monkeypatch.setattr(surfaces, "make_case", lambda *_: part_case())
    names = ("skin", "bones", "spine", "out")
    words = [word for name in names for word in (f"--{name}", str(tmp_path / name))]
    assert main(["make-case", *words]) == OK
    said = capsys.readouterr().out
    assert f"{tmp_path / 'spine'} has no T1 to T3: the curve fades out there" in said
    assert (tmp_path / "out" / "case.toml").is_file()
    assert main(["make-case", *words, "--correction", "-0.5"]) == BAD_INPUT
    assert main(["make-case", *words, "--correction", "1.0"]) == BAD_INPUT  # as the folder is a case by now
    assert "case folder" in capsys.readouterr().err.splitlines()[-1]


def test_the_demo_is_the_operation_that_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fused from T4 to L1; 65 % of the curve and 40 % of its rotation are taken away, with intervals."""
    asked: list[Any] = []

    def seen(*arguments: Any, **named: Any) -> None:
        asked.append((arguments, named))
        raise InputError("seen")

    monkeypatch.setattr(phantom, "phantom_case", lambda: "phantom")
    monkeypatch.setattr(simulate_command, "simulate", seen)
    assert main(["demo"]) == BAD_INPUT
    (((case, plan, options, _), named),) = asked
    (curve,) = plan.curves
    assert (case, plan.uiv, plan.liv, curve.apex) == ("phantom", "T4", "L1", "T8")
    assert (curve.correction, curve.derotation) == (0.65, 0.4)
    assert options.bands
    assert named["folder"] == Path("results/demo")
    assert named["warnings"] == ()


def test_triangles_that_cross_are_written_where_the_result_would_be(tmp_path: Path) -> None:
    surface = sphere(10.0)
    crossing = pytest.raises(InputError, match=r"look at the triangles that cross in .*crossings\.ply")
    with crossing, crossings_written(tmp_path / "not" / "yet"):
        raise CrossingError("they cross", surface, np.array([[0, 1]]))
    assert len(read_surface(tmp_path / "not" / "yet" / "crossings.ply").faces) == 2


def test_what_is_printed_for_the_known_patient_is_as_accepted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = known_case(actual=ACTUAL)[0]
    assert case.actual_skin is not None
    write_surface(tmp_path / "actual.ply", case.actual_skin)
    write_known_result(tmp_path / "result")
    result, lines = str(tmp_path / "result"), list[str]()
    for words in (
        ["measure", result, "--against", str(tmp_path / "actual.ply"), "--out", str(tmp_path / "table")],
        ["export", result, "--out", str(tmp_path / "mesh.vtu")],
        ["export", result, "--out", str(tmp_path / "skin.glb")],
        ["report", result],
        ["view", result],
    ):
        status, said = main(words), capsys.readouterr()
        for title, text in (("ends", str(status)), ("prints", said.out), ("warns", said.err)):
            lines += [f"== {words[0]} {title}", *text.replace(str(tmp_path), "FOLDER").splitlines()]
    check_shown("console", (line for line in lines if not re.search(r": [\d.]+ s$", line)))
