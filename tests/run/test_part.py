"""A part of the body without a spine, from a case to its report and its row in a cohort.

A box around four blocks of bone: a vertebra behind, the sternum 30 mm before it, which moves forward, and a rib on
each side, whose inner sides are 130 mm apart.
"""

import contextlib
import io
import json
import os
import re
import shutil
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.asserting import not_none, refuses
from support.drawn import Page, drawn_figures
from support.shown import check_shown, report_lines
from support.small_case import part_case
from support.small_patient import block
from support.small_trunk import small_trunk
from warp_trunk.case import Case, read_case, write_case
from warp_trunk.case.landmarks import NO_LANDMARKS, Landmarks
from warp_trunk.case.motions import Motion
from warp_trunk.case.points import Points
from warp_trunk.cli import main
from warp_trunk.cohort import one_case
from warp_trunk.cohort.one_case import CohortOptions, do_case
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import enclosed_volume
from warp_trunk.io.surface_files import write_surface
from warp_trunk.io.trunk_file import write_trunk
from warp_trunk.measures.body_part import agreement, swept_volumes
from warp_trunk.measures.quantities import MeasureTable
from warp_trunk.results import read_result
from warp_trunk.run.options import RunOptions
from warp_trunk.run.simulate import simulate

BLOCKS = {"T8": (0.0, 0.0), "sternum": (0.0, -50.0), "rib_left_05": (75.0, 0.0), "rib_right_05": (-75.0, 0.0)}
"""Middles of the bones, seen from above [mm]."""


@cache
def small_part() -> tuple[Case, TrunkMesh]:
    box, skin = small_trunk()
    bone = np.full(len(box.nodes), -1, dtype=np.int32)
    for number, (x, y) in enumerate(BLOCKS.values()):
        beside = np.abs(box.nodes - [x, y, 210.0])
        bone[(beside < [1.0, 1.0, 80.0]).all(axis=1)] = number
    nothing = np.zeros((0, 3), dtype=np.int32)
    mesh = replace(box, bone=bone, bone_names=tuple(BLOCKS), bone_faces=nothing)
    bones = {
        name: block(skin, mesh.nodes[bone == number] + np.array([[[-9.0]], [[9.0]]]))
        for number, name in enumerate(BLOCKS)
    }
    marks = Landmarks(
        ("tip", "side", "bone", "still"),
        np.array([[0.0, -100.0, 210.0], [150.0, 0.0, 210.0], [0.0, -60.0, 210.0], [0.0, 10.0, 210.0]]),
    )
    points = Points(marks, {"tip": "bone", "side": "still"})
    actual = skin.moved(skin.vertices - np.array([0.0, 3.0, 0.0]))
    return Case("part", skin, bones, NO_LANDMARKS, points=points, actual_skin=actual), mesh


@dataclass(frozen=True)
class Part:
    """Two results, and what the command said."""

    folder: Path
    said: str


@pytest.fixture(scope="module")
def part(tmp_path_factory: pytest.TempPathFactory) -> Part:
    """The sternum 4 and 10 mm forward."""
    folder, (case, mesh) = tmp_path_factory.mktemp("part"), small_part()
    write_case(folder / "case", case)
    write_trunk(folder / "tissue.vtu", mesh)
    words = ["simulate", str(folder / "case"), "--from-mesh", str(folder / "tissue.vtu"), "--no-record"]
    for name, way in (("near", -4.0), ("far", -10.0)):
        text = f"[sternum]\ntranslation = [0, {way}, 0]\n"
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
        words += ["--motions", str(folder / f"{name}.toml")]
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as said:
        patch.chdir(folder)
        words += ["--out", "out", "--tolerance", "1e-5", "--precision", "float64", "--device", "cpu"]
        assert main([*words, "--threads", "1"]) == 0
    return Part(folder, said.getvalue())


def test_the_console_and_the_report_are_as_accepted(part: Part) -> None:
    with drawn_figures() as figures:
        assert main(["report", str(part.folder / "out" / "far")]) == 0
    del figures["convergence"]  # over time
    page = Page((part.folder / "out" / "far" / "report.html").read_text(encoding="utf-8"))
    said = re.sub(r"in [\d.]+ s$|uv run ", "", part.said, flags=re.MULTILINE)
    timed = re.compile(r"Seconds load.*|(load|surface|mesh|compile|relax|record|total) \|.*")
    lines = (timed.sub("", line).replace(str(part.folder), "FOLDER") for line in report_lines(page, figures))
    check_shown("part", [said.replace(str(part.folder), "FOLDER"), *lines])
    for word in ("Cobb", "hump", "BSR"):
        assert word not in page.words


def test_each_result_has_its_motions_and_its_points_their_ways(part: Part) -> None:
    near, far = (read_result(part.folder / "out" / name) for name in ("near", "far"))
    for result, way in ((near, -4.0), (far, -10.0)):
        assert result.motions == {"sternum": Motion(translation=(0.0, way, 0.0))}
        tip, side, bone, still = result.summary.points
        np.testing.assert_allclose([bone.way, still.way], [[0.0, way, 0.0], [0.0, 0.0, 0.0]], atol=1e-6)
        row = np.linalg.norm(result.skin_before.vertices - [0.0, -100.0, 210.0], axis=1).argmin()
        moved = result.skin.vertices[row] - result.skin_before.vertices[row]
        assert tip.ratio == pytest.approx(moved[1] / way, abs=0.02)
        assert side.ratio is None  # its bone stands still
    assert near.fingerprint != replace(near, motions=far.motions).fingerprint
    was, will = not_none(far.summary.chest)
    assert (was.haller, will.haller) == pytest.approx((130.0 / 30.0, 130.0 / 40.0), rel=0.02)


def test_a_prediction_is_judged_by_its_own_skin(
    part: Part, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = read_result(part.folder / "out" / "far")
    write_surface(tmp_path / "actual.ply", result.skin)
    words = ["measure", str(result.folder), "--against", str(tmp_path / "actual.ply"), "--out", str(tmp_path)]
    assert main(words) == 0
    assert capsys.readouterr().out.startswith("part, motions far: the skin moves by 8.6 mm\n")
    rows = json.loads((tmp_path / "measures.json").read_text(encoding="utf-8"))["measures"]
    error = {row["quantity"]: row["value"] for row in rows if row["state"] == "error"}
    assert error["distance_within_2_mm_percent"] == pytest.approx(100.0)
    assert error["distance_maximum_mm"] < 0.01
    assert (tmp_path / "measures.png").stat().st_size > 10_000


def test_a_cohort_judges_a_part_by_its_actual_skin(
    part: Part, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The skin comes 3 mm forward after surgery, which is the error of the guess that nothing changes."""

    def meshed(case: Case, plan: None, options: RunOptions, *more: Any, **named: Any) -> Any:
        return simulate(case, plan, replace(options, from_mesh=part.folder / "tissue.vtu"), *more, **named)

    monkeypatch.setattr(one_case, "simulate", meshed)
    write_case(tmp_path / "a", replace(small_part()[0], motions={"sternum": Motion(translation=(0.0, -4.0, 0.0))}))
    table = MeasureTable((row := do_case(tmp_path / "a", tmp_path / "out", CohortOptions()).row).measures)
    assert row.counts, row.reason
    assert 0.1 < not_none(table.value("error", "distance_mean_mm")) < 3.0
    assert 0.1 < not_none(table.value("before", "distance_mean_mm")) < 3.0
    assert table.value("error", "distance_mean_mm") != table.value("before", "distance_mean_mm")


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
    with refuses(says):
        read_case(tmp_path)


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
