"""The commands of Start and of the how-to pages run as they stand, on a synthetic patient and with small meshes.

A block that begins with ```sh is run; one of another program, or of a cluster, begins with ```text.
"""

import contextlib
import dataclasses
import io
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import trimesh

from support.biplanar import biplanar, write_film
from support.cohort_cases import turned_case
from support.partial_scans import scan
from support.phantoms import coarse_phantom
from warp_trunk.bone_motion.plan import CurvePlan, Plan, read_plan, write_plan
from warp_trunk.case import Case, read_case, write_case
from warp_trunk.case.case import Study
from warp_trunk.case.landmarks import Landmarks, write_landmarks
from warp_trunk.case.tissue_file import read_tissue_file
from warp_trunk.cli import main
from warp_trunk.io.surface_files import read_surface, write_surface
from warp_trunk.measures.measures import measure_spine
from warp_trunk.measures.quantities import Measured, MeasureTable
from warp_trunk.preparation.back_scan.scan import cut_back
from warp_trunk.preparation.deformity import SpineCurve, impose, make_case
from warp_trunk.preparation.phantom import straight_trunk
from warp_trunk.results.result import read_result
from warp_trunk.results.summary import read_summary

ROOT = Path(__file__).parents[2]
MESH = "--tets 26000 --bone-voxel 8 --bone-tolerance 2"
"""Added to each simulation of a patient with a coarse skin, so that it takes some seconds ..."""
SMALL = f"{MESH} --increments 2"
"""... where the page leaves the increments as they are, ..."""
SMALLEST = "--tets 8000 --bone-voxel 8 --increments 2"
"""... of the patients of a study, who have a few bones, ..."""
DEMO = "--tets 50000 --bone-voxel 8 --bone-tolerance 2 --increments 2"
"""... of the synthetic trunk as it is, ..."""
FINE = "--tets 150000 --increments 2"
"""... and of real anatomy."""
SIMULATING = re.compile("(simulate|demo|cohort|calibrate|plan .*--(aim|live)) ?.*")
SERVING = re.compile("view .*|plan .*--live.*")
pytestmark = pytest.mark.slow


def commands(page: str) -> list[str]:
    """All lines of the blocks of a page, without the command that chooses the environment."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    blocks = "".join(re.findall(r"^```sh\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE))
    assert blocks, f"{page} has no block of commands"
    return re.sub("^uv run ", "", blocks.replace("\\\n", " "), flags=re.MULTILINE).splitlines()


def served(words: list[str]) -> str:
    """Runs a program that serves until it is asked to end, which it is at its first address."""
    program = [sys.executable, "-c", "from warp_trunk.cli import main; raise SystemExit(main())"]
    environment = os.environ | {"BROWSER": "true", "PYTHONUNBUFFERED": "1"}
    said = ""
    with subprocess.Popen(
        [*program, *words], env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8"
    ) as process:
        late = threading.Timer(60.0, process.kill)
        late.start()
        assert process.stdout is not None
        for line in process.stdout:
            if "http://" in line and "http://" not in said:
                process.send_signal(signal.SIGINT)
            said += line
        late.cancel()
    assert process.returncode in (0, 130), said[-3000:]
    return said


def run(page: str, folder: Path, small: str = SMALL) -> str:
    """Runs a page in a folder, the program's commands in this process with small meshes; returns the output.

    That the program starts as one of its own is shown by .ci/run, which installs it.
    """
    said = io.StringIO()
    with contextlib.chdir(folder):
        for command in commands(page):
            program, *words = shlex.split(command, comments=True) or [""]
            line = " ".join(words)
            if program == "warp-trunk":
                words += small.split() if SIMULATING.fullmatch(line) else []
                if SERVING.fullmatch(line):
                    said.write(served(words))
                    continue
                with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
                    status = main(words)
                assert status == 0, f"{command}\n{said.getvalue()[-3000:]}"
            elif program not in ("", "uv", "pip"):
                subprocess.run([program, *words], check=True)
    return said.getvalue()


def number(result: Path, quantity: str, level: str, state: str = "predicted") -> Measured:
    """A measured number of a result."""
    row = MeasureTable(read_summary(result).measures).row(state, quantity, level)
    assert row is not None, f"{quantity} at {level}"
    return row


def write_patient(folder: Path) -> None:
    """The patient of the pages: a case, two plans, the scan after surgery."""
    case = dataclasses.replace(coarse_phantom(), name="anna")
    write_case(folder / "cases" / "anna", case)
    write_surface(folder / "scan_after.ply", case.skin)
    for liv in ("L1", "L3"):
        plan = Plan(uiv="T4", liv=liv, curves=(CurvePlan(apex="T8", correction=0.65, derotation=0.4),))
        write_plan(folder / f"t4_{liv.lower()}.toml", plan)


def write_films(folder: Path, marks: dict[str, Landmarks]) -> None:
    """Both films of several sets of landmarks, each set with a prefix of its files; all share the projections."""
    names = tuple(name for points in marks.values() for name in points.names)
    films = biplanar(Landmarks(names, np.vstack([points.points for points in marks.values()])))
    for view, film in zip(("pa", "lateral"), films, strict=True):
        for prefix, points in marks.items():
            rows = [film.names.index(name) for name in points.names]
            part = dataclasses.replace(film, names=points.names, points=film.points[rows])
            write_film(folder / f"{prefix}{view}.csv", folder / f"{view}.txt", part)


def test_a_patient_is_planned(tmp_path: Path) -> None:
    """The curve falls by the part that the plan corrects, and the report states it."""
    write_patient(tmp_path)
    run("planning.md", tmp_path)
    result = tmp_path / "results" / "anna_t4_l1"
    main = max(read_result(result).measures_before.cobb, key=lambda curve: curve.angle)
    after = number(result, "cobb_deg", main.ends).value
    assert after == pytest.approx(0.35 * main.angle, abs=0.5)
    assert f"to {after:.0f} degrees" in (result / "report.html").read_text(encoding="utf-8")


def test_plans_are_compared_and_the_best_is_found_within_its_bounds(tmp_path: Path) -> None:
    write_patient(tmp_path)
    said = run("compare.md", tmp_path)
    (page,) = tmp_path.rglob("plans.html")
    assert "t4_l1" in page.read_text(encoding="utf-8")
    assert re.search(r"Gained: -?[\d.]+ ± [\d.]+ mm|is better than the plan as given", said)
    (curve,) = read_plan(tmp_path / "cases" / "anna_best" / "plan.toml").curves
    assert curve.correction is not None
    assert curve.derotation is not None
    assert 0.5 <= curve.correction <= 0.8
    assert 0.2 <= curve.derotation <= 0.6


def test_the_planning_page_prints_its_address_on_the_loopback(tmp_path: Path) -> None:
    write_patient(tmp_path)
    said = run("live.md", tmp_path)
    assert "http://127.0.0.1:8200" in said.replace("localhost", "127.0.0.1")


def test_intervals_are_in_the_summary_and_judge_the_actual_back(tmp_path: Path) -> None:
    write_patient(tmp_path)
    said = run("how_sure.md", tmp_path)
    row = number(tmp_path / "results" / "anna", "bsr_deg", "T8")
    assert row.low is not None
    assert row.high is not None
    assert row.value is not None
    assert row.low < row.value < row.high
    assert re.search(r"in its 95 % band at \d+ of \d+ levels", said)


def test_a_result_is_exported_for_slides_and_another_solver(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_patient(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "cases/anna", *SMALL.split()]) == 0
    run("look.md", tmp_path)
    assert (tmp_path / "results" / "anna" / "skin.glb").read_bytes()[:4] == b"glTF"
    assert "*MATERIAL" in (tmp_path / "trunk.inp").read_text(encoding="utf-8").upper()


def test_the_papers_are_run_by_one_command_and_by_one_script(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_patient(tmp_path)
    run("papers.md", tmp_path, MESH)
    (script,) = re.findall(
        r"^```python\n(.*?)^```$", (ROOT / "docs" / "papers.md").read_text(encoding="utf-8"), re.DOTALL | re.M
    )
    mesh = "mesh=wt.MeshOptions(tets=26_000, bone_voxel=8.0, bone_tolerance=2.0)"
    small = script.replace("alpha=0.3)", f"alpha=0.3, {mesh})")
    assert small != script
    monkeypatch.chdir(tmp_path)
    exec(small, {})
    said = [read_summary(tmp_path / "results" / name).springs for name in ("anna_papers", "anna_papers_python")]
    assert said[0] == said[1]
    assert said[0] is not None
    assert (said[0].epsilon, said[0].theta, said[0].alpha) == pytest.approx((2.0, 5.0, 0.3), rel=1e-12)


def test_the_demo_runs(tmp_path: Path) -> None:
    assert "CONVERGED" in run("index.md", tmp_path, DEMO)
    before = read_result(tmp_path / "results" / "demo").measures_before
    assert max(curve.angle for curve in before.cobb) == pytest.approx(55.0, abs=1.0)
    assert (tmp_path / "results" / "demo" / "report.html").is_file()


def test_the_demo_runs_with_another_energy(tmp_path: Path) -> None:
    run("add_energy.md", tmp_path, DEMO)
    assert read_summary(tmp_path / "results" / "demo").springs is not None


@pytest.fixture(scope="module")
def anatomy() -> Path:
    """Real anatomy: vertebrae with canals, on which landmarks can be found."""
    if not (folder := os.environ.get("WARP_TRUNK_ANATOMY")):
        pytest.skip("WARP_TRUNK_ANATOMY names no folder")
    return Path(folder)


def test_a_curve_is_imposed(anatomy: Path, tmp_path: Path) -> None:
    for name in ("skin.ply", "bones"):
        (tmp_path / name).symlink_to(anatomy / name)
    run("anatomy.md", tmp_path)
    case = read_case(tmp_path / "cases" / "thoracic")
    assert max(curve.angle for curve in measure_spine(case.landmarks_before).cobb) == pytest.approx(60.0, abs=1.0)


def curved(anatomy: Path) -> Case:
    """A thoracic curve of 55 degrees imposed on real anatomy."""
    bones = {path.stem: read_surface(path) for path in sorted((anatomy / "bones").glob("*.ply"))}
    return make_case(read_surface(anatomy / "skin.ply"), bones, SpineCurve(kind="thoracic", cobb=55.0), 0.5)


def test_a_case_is_made_of_a_ct(anatomy: Path, tmp_path: Path) -> None:
    case = curved(anatomy)
    write_case(tmp_path / "surfaces", case)
    voxelise = [sys.executable, ROOT / "scripts" / "voxelise_case.py", "surfaces", "ct"]
    subprocess.run([*voxelise, "--spacing", "1.5", "1.5", "1.5"], cwd=tmp_path, check=True)
    (tmp_path / "ct" / "masks").rename(tmp_path / "seg")
    (tmp_path / "body").mkdir()
    (tmp_path / "ct" / "body.nii.gz").rename(tmp_path / "body" / "body_trunc.nii.gz")
    (tmp_path / "surfaces" / "landmarks_before.csv").unlink()
    run("from_ct.md", tmp_path, FINE)
    assert (tmp_path / "patient" / "landmarks_before.png").read_bytes()[1:4] == b"PNG"
    imported = read_case(tmp_path / "patient").landmarks_before
    truth = [case.landmarks_before.point(name) for name in imported.names]
    apart = np.linalg.norm(imported.points - truth, axis=1)
    assert apart.mean() < 0.6  # the page says 0.45 mm
    assert (tmp_path / "results" / "planned" / "report.html").is_file()


def test_a_case_is_made_of_films(anatomy: Path, tmp_path: Path) -> None:
    case = curved(anatomy)
    (tmp_path / "atlas").symlink_to(anatomy)
    vertices = case.skin.vertices
    markers = vertices[:: len(vertices) // 20]
    marks = Landmarks(tuple(f"marker_{number}" for number in range(len(markers))), markers)
    write_films(tmp_path, {"": case.landmarks_before, "markers_": marks})
    write_landmarks(tmp_path / "markers_scan.csv", marks)
    parts = scan(case.skin, noise=0.0).parts.values()
    for name, part in zip(("front", "left", "back", "right"), parts, strict=True):
        write_surface(tmp_path / f"{name}.ply", part)
    run("from_films.md", tmp_path, FINE)
    fitted = read_case(tmp_path / "patient")
    true = case.landmarks_before
    apart = [fitted.landmarks_before.point(name) - true.point(name) for name in true.names]
    assert np.abs(apart).max() < 0.1  # films without errors
    assert (tmp_path / "patient" / "bones" / "atlas_fit.csv").is_file()
    assert (tmp_path / "results" / "planned" / "report.html").is_file()


def test_a_case_is_made_of_a_scan_of_the_back(tmp_path: Path) -> None:
    """The back is cut from a synthetic body."""
    skin, bones, straight = straight_trunk()
    skin, bones, marks = impose(skin, bones, straight, SpineCurve(cobb=50.0))
    points, spine, markers = cut_back(Case(name="whole", skin=skin, bones=bones, landmarks_before=marks))
    trimesh.PointCloud(points).export(tmp_path / "back.ply")
    np.savetxt(tmp_path / "spine.csv", spine.line, delimiter=",", header="x,y,z", comments="")
    write_landmarks(tmp_path / "markers.csv", markers)
    run("from_a_back_scan.md", tmp_path, DEMO.replace("50000", "70000"))
    page = (tmp_path / "results" / "planned" / "report.html").read_text(encoding="utf-8")
    assert "Fitted from a scan of the back" in page


def write_study(tmp_path: Path) -> None:
    """Three patients with a known result, and a planned one."""
    for name, degrees in (("a", 1.0), ("b", -2.0), ("c", 2.0)):
        study = Study(patient=name, pose="surgery", synthetic=True)
        write_case(tmp_path / "patients" / name, turned_case(name, degrees, study))
    write_case(tmp_path / "planned", turned_case("planned", 1.0))


def test_a_cohort_is_simulated(tmp_path: Path) -> None:
    write_study(tmp_path)
    run("cohorts.md", tmp_path, SMALLEST)
    rows = (tmp_path / "study" / "cases.csv").read_text(encoding="utf-8").splitlines()
    assert [row.split(",")[0] for row in rows[1:]] == ["a", "b", "c"]
    for name in ("cohort.csv", "cohort.json", "cohort.html", "a/summary.json"):
        assert (tmp_path / "study" / name).is_file(), name


def test_constants_are_calibrated_and_used(tmp_path: Path) -> None:
    write_study(tmp_path)
    run("calibration.md", tmp_path, SMALLEST)
    constants = read_tissue_file(tmp_path / "tissue.toml")
    assert constants.keys() == {"poisson_ratio", "ribs.reversible_part"}
    (tissue,) = read_summary(tmp_path / "results" / "planned").tissues
    assert tissue.poisson_ratio == pytest.approx(constants["poisson_ratio"])
    assert (tmp_path / "tissue.html").is_file()
