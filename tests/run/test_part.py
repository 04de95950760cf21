"""A part of the body without a spine, from a case to its report."""

import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.drawn import drawn_figures
from support.small_case import part_case
from warp_trunk.case import read_case, write_case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.motions import Motion
from warp_trunk.case.points import Points
from warp_trunk.cli import main
from warp_trunk.cohort.one_case import CohortOptions, do_case
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import enclosed_volume
from warp_trunk.io.surface_files import write_surface
from warp_trunk.measures.body_part import agreement, swept_volumes
from warp_trunk.measures.quantities import MeasureTable
from warp_trunk.meshing import MeshOptions
from warp_trunk.report.writing import write_report
from warp_trunk.results import read_result
from warp_trunk.results.summary_text import plain
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.simulate import simulate

OPTIONS = RunOptions(
    mesh=MeshOptions(tets=8000, bone_voxel=4.0),
    simulation=SimulationOptions(increments=2),
)
EXECUTION = Execution(device="cpu", threads=1, cache=False)
QUIET = replace(EXECUTION, record=False)


@pytest.fixture(scope="module")
def front(tmp_path_factory):
    """The front bone 6 mm forward."""
    case = part_case(front=Motion(translation=(0.0, -6.0, 0.0)))
    actual = Surface(case.skin.vertices + np.array([0.0, -1.0, 0.0]), case.skin.faces)
    return simulate(
        replace(case, actual_skin=actual), None, OPTIONS, EXECUTION, folder=tmp_path_factory.mktemp("part") / "out"
    )


def test_skin_follows_the_bone_that_moves_and_stays_where_none_does(front):
    assert front.status is RelaxStatus.CONVERGED
    result = read_result(front.folder)
    way = result.skin.vertices - result.skin_before.vertices
    foremost, hindmost = result.skin_before.vertices[:, 1].argmin(), result.skin_before.vertices[:, 1].argmax()
    assert -6.0 < way[foremost, 1] < -3.0
    assert np.linalg.norm(way[hindmost]) < 0.5
    assert result.landmarks_before.names == ()


def test_its_report_speaks_of_no_vertebra(front, tmp_path):
    with drawn_figures() as figures:
        page = write_report(front, tmp_path)
    text = re.sub('base64,[^"]*', "", page.read_text(encoding="utf-8"))
    for heading in ("<h1>The skin before and after surgery</h1>", "<h2>From the two sides that change most</h2>"):
        assert heading in text
    assert "The back before" not in text
    headings = [line.strip() for line in plain(front).splitlines()]
    assert "The skin" in headings
    assert "The back" not in headings
    for word in ("Cobb", "vertebra", "hump", "BSR"):
        assert word not in text
    assert {path.stem for path in (tmp_path / "report").glob("*.png")} >= {"first", "second", "sections", "error"}
    assert front.summary.has_spine is False
    result = read_result(front.folder)
    way = np.linalg.norm(result.skin.vertices - result.skin_before.vertices, axis=1)
    most = result.skin_before.vertices[way.argmax()]
    panels = {axes.get_title().rpartition(" at ")[2]: axes.get_xlabel() for axes in figures["sections"].axes}
    assert panels == {
        f"{axis} = {value:.0f} mm": "to the back [mm]" if axis == "x" else "to the patient's left [mm]"
        for axis, value in zip("xyz", most, strict=True)
    }
    for axes in figures["sections"].axes:
        lines = np.concatenate([path.vertices for drawn in axes.collections for path in drawn.get_paths()])
        for ends, values in zip((axes.get_xlim(), axes.get_ylim()), lines.T, strict=True):
            inside = (min(ends) < values) & (values < max(ends))
            assert inside.mean() > 0.3  # about the place of the largest change


def test_several_motions_share_a_patient(tmp_path, capsys):
    write_case(tmp_path / "case", part_case(front=Motion(translation=(0.0, -1.0, 0.0))))
    words = ["simulate", str(tmp_path / "case"), "--out", str(tmp_path / "out"), "--tets", "8000", "--no-record"]
    for name, way in (("near", -1.0), ("far", -4.0)):
        (tmp_path / f"{name}.toml").write_text(f"[front]\ntranslation = [0, {way}, 0]\n", encoding="utf-8")
        words += ["--motions", str(tmp_path / f"{name}.toml")]
    assert main(words) == 0
    ways = [read_result(tmp_path / "out" / name) for name in ("near", "far")]
    moved = [np.abs(result.skin.vertices - result.skin_before.vertices).max() for result in ways]
    assert moved[1] > 3.0 * moved[0]
    assert capsys.readouterr().err.count("meshing the soft tissue") == 1
    for result, way in zip(ways, (-1.0, -4.0), strict=True):  # a result says what moved its bones
        assert result.motions == {"front": Motion(translation=(0.0, way, 0.0))}
        assert "<h3>Motions</h3>" in write_report(result, tmp_path).read_text(encoding="utf-8")
    assert ways[0].fingerprint != replace(ways[0], motions=ways[1].motions).fingerprint
    assert main([*words[:3], str(tmp_path / "planless"), *words[4:7]]) == 0
    assert read_result(tmp_path / "planless").motions["front"].translation == (0.0, -1.0, 0.0)


def test_swept_volumes_are_those_between_the_skins():
    skin = part_case().skin
    rng = np.random.default_rng(3)
    after = Surface(skin.vertices + rng.normal(size=skin.vertices.shape), skin.faces)
    outward, inward = swept_volumes(skin, after)
    assert outward - inward == pytest.approx((enclosed_volume(after) - enclosed_volume(skin)) / 1000.0, rel=1e-9)
    grown = Surface(1.1 * (skin.vertices - [0, 0, 100]) + [0, 0, 100], skin.faces)
    assert swept_volumes(skin, grown)[1] == 0.0


def test_agreement_of_a_larger_ball_is_its_larger_radius():
    skin = part_case().skin
    for more, within in ((1.5, 100.0), (2.5, 0.0)):
        larger = Surface((1.0 + more / 80.0) * (skin.vertices - [0, 0, 100]) + [0, 0, 100], skin.faces)
        agreed = agreement(larger, skin)
        assert agreed.distance_within_2_mm_percent == pytest.approx(within)
        np.testing.assert_allclose(agreed.signed, more, atol=0.1)
        assert agreed.distance_mean_mm == pytest.approx(more, abs=0.1)


def test_points_go_with_their_surface_and_the_ratio_is_that_of_the_ways(tmp_path):
    marks = Landmarks(
        ("tip", "lip", "bone", "still"),
        np.array([[0.0, -80.0, 100.0], [0.0, -79.0, 108.0], [0.0, -63.0, 100.0], [25.0, 20.0, 100.0]]),
    )
    case = part_case(front=Motion(translation=(0.0, -6.0, 0.0)))
    case = replace(case, points=Points(marks, {"tip": "bone", "lip": "still"}))
    write_case(tmp_path / "case", case)
    read = read_case(tmp_path / "case")
    assert read.points.pairs == case.points.pairs
    done = simulate(read, folder=tmp_path / "out", options=OPTIONS, execution=QUIET)
    tip, lip, bone, still = done.summary.points
    assert (tip.on, bone.on, still.on) == ("skin", "front", "core")
    np.testing.assert_allclose(bone.way, [0.0, -6.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(still.way, 0.0, atol=1e-6)
    result = read_result(done.folder)
    foremost = result.skin_before.vertices[:, 1].argmin()
    way = result.skin.vertices[foremost] - result.skin_before.vertices[foremost]
    assert tip.ratio == pytest.approx(way[1] / -6.0, abs=0.02)
    assert lip.ratio is None  # its bone stands still


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("tip,0,-60,100,", "mm from front, the nearest surface"),
        ("tip,0,-80,100,tip", "lies on skin and 'tip' on skin"),
    ],
)
def test_points_that_lie_nowhere_or_compare_nothing_are_refused(tmp_path, row, says):
    write_case(tmp_path, part_case(front=Motion(translation=(0.0, -1.0, 0.0))))
    (tmp_path / "points.csv").write_text(f"name,x,y,z,bone_point\n{row}\n".replace("-60", "-71"), encoding="utf-8")
    with pytest.raises(InputError, match=says):
        read_case(tmp_path)


def test_a_prediction_is_judged_by_the_share_that_is_near(front, tmp_path, capsys):
    actual = tmp_path / "actual.ply"
    write_surface(actual, read_result(front.folder).skin)
    assert main(["measure", str(front.folder), "--against", str(actual), "--out", str(tmp_path)]) == 0
    rows = json.loads((tmp_path / "measures.json").read_text(encoding="utf-8"))["measures"]
    error = {row["quantity"]: row["value"] for row in rows if row["state"] == "error"}
    assert error["distance_within_2_mm_percent"] == pytest.approx(100.0)
    assert error["distance_maximum_mm"] < 0.01
    assert (tmp_path / "measures.png").stat().st_size > 10_000


@pytest.mark.skipif(not os.environ.get("WARP_TRUNK_REGIONS"), reason="WARP_TRUNK_REGIONS names no folder")
@pytest.mark.parametrize(("forward", "chin", "lip"), [(6.0, 0.97, 0.77), (-6.0, 0.96, 0.77)])
def test_a_cut_jaw_takes_chin_and_lip_along(tmp_path, forward, chin, lip):
    head = Path(os.environ["WARP_TRUNK_REGIONS"]) / "head"
    shutil.copytree(head / "bones", tmp_path / "case" / "bones")
    shutil.copy(head / "skin_mouth.ply", tmp_path / "case" / "skin.ply")
    files = {
        "case.toml": "",
        "motions.toml": f"[mandible]\ntranslation = [0, {-forward}, 0]\n",
        "points.csv": "name,x,y,z,bone_point\nchin,0,-184.7,1428,tooth\nlip,1.1,-187.5,1452.1,tooth\n"
        "tooth,-4.6,-176.9,1453.4,\n",
    }
    for name, text in files.items():
        (tmp_path / "case" / name).write_text(text, encoding="utf-8")
    words = ["--bone", "mandible", "--plane", "0", "-118", "1470", "0", "0", "1"]
    assert main(["cut", str(tmp_path / "case"), *words, "--names", "mandible", "ramus_left", "ramus_right"]) == 0
    assert main(["simulate", str(tmp_path / "case"), "--out", str(tmp_path / "out"), "--no-record"]) == 0
    summary = read_result(tmp_path / "out").summary
    assert (summary.status, summary.inverted_tets) == ("CONVERGED", 0)
    assert [point.ratio for point in summary.points[:2]] == pytest.approx([chin, lip], abs=0.05)


def test_a_cohort_judges_a_part_by_its_actual_skin(tmp_path):
    """The skin is as before, so that the prediction is the error and nothing else is right."""
    case = part_case(front=Motion(translation=(0.0, -6.0, 0.0)))
    write_case(tmp_path / "a", replace(case, actual_skin=case.skin))
    row = do_case(tmp_path / "a", tmp_path / "out", CohortOptions(run=OPTIONS, execution=QUIET)).row
    table = MeasureTable(row.measures)
    assert row.counts
    assert 0.1 < (table.value("error", "distance_mean_mm") or 0.0) < 6.0
    assert table.value("before", "distance_mean_mm") == 0.0
