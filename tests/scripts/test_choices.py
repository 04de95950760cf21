"""The map of constants and the error budget: their random errors, differences, kept runs, tables and pictures."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import error_budget
import map_constants
import numpy as np
import pytest
from choices.budget import measured
from choices.choices import Choices
from choices.difference import difference
from choices.errors import SMOOTH, moved_bones, moved_landmarks, smooth_field
from choices.rows import PAPERS, Row, rows
from choices.study import Study

from support.small_trunk import small_case
from support.synthetic import sphere
from support.trunk_shapes import ASIS, LEVELS, rotation, spine, twisted
from warp_trunk import Landmarks, Surface
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.measures.regions import regions_of


def test_landmark_errors_are_as_the_papers_state() -> None:
    there = Landmarks(tuple(f"p{i}" for i in range(4000)), np.zeros((4000, 3)))
    error = moved_landmarks(there, np.random.default_rng(1)).points
    length = np.linalg.norm(error, axis=1)
    assert length.mean() == pytest.approx(2.1, abs=0.07)
    assert length.std() == pytest.approx(1.5, abs=0.07)
    heights = error / length[:, None]  # by Archimedes uniform from -1 to 1 for directions that favour none
    for power, moment in ((1, 0.0), (2, 1.0 / 3.0), (4, 1.0 / 5.0)):
        assert np.mean(heights**power, axis=0) == pytest.approx(moment, abs=0.03)


def test_bone_errors_are_smooth_and_each_bones_own() -> None:
    points = np.array([[0.0, 0.0, 0.0], [SMOOTH, 0.0, 0.0], [0.0, 5.0 * SMOOTH, 0.0]])
    random = np.random.default_rng(2)
    field = np.array([smooth_field(points, random) for _ in range(3000)])
    assert np.mean(field**2, axis=0) == pytest.approx(1.0, abs=0.12)
    assert np.mean(field[:, 0] * field[:, 1]) == pytest.approx(np.exp(-0.5), abs=0.05)
    assert np.mean(field[:, 0] * field[:, 2]) == pytest.approx(0.0, abs=0.05)
    bones = {"one": sphere(10.0, subdivisions=1), "other": sphere(10.0, subdivisions=1)}
    moved = moved_bones(bones, 3.5, random)
    errors = np.array([moved[name].vertices - bones[name].vertices for name in bones])
    assert np.linalg.norm(errors, axis=2).mean() == pytest.approx(3.5)
    assert np.abs(errors[0] - errors[1]).max() > 1.0


def test_only_the_back_counts_and_the_rotation_by_level() -> None:
    landmarks = spine(LEVELS, (0.0, 0.0))
    skin = twisted(0.0)
    regions = regions_of(skin, landmarks)
    shift = np.where(regions.masks["back"][:, None], [2.0, 1.0, 2.0], [50.0, 0.0, 0.0])
    found = difference(Surface(skin.vertices + shift, skin.faces), skin, landmarks)
    assert found.mean_mm == pytest.approx(3.0)
    assert found.max_mm == pytest.approx(3.0)
    found = difference(twisted(4.0, 4.0), skin, landmarks)
    assert found.bsr_deg == pytest.approx(4.0, abs=0.02)
    turned_pelvis = spine(LEVELS, (0.0, 0.0), tuple(np.array(ASIS) @ rotation(3.0)))
    assert difference(skin, skin, landmarks, turned_pelvis).bsr_deg == pytest.approx(3.0, abs=0.02)


@pytest.fixture
def small(tmp_path: Path) -> Study:
    case, trunk = small_case()
    return Study(case, tmp_path / "kept", make_mesh=lambda skin, bones, options: trunk)


def test_a_run_is_made_once(small: Study, capsys: pytest.CaptureFixture[str]) -> None:
    two = replace(PAPERS, increments=2)
    first = small.ending(two)
    assert "running" in capsys.readouterr().out
    assert first.status == "CONVERGED"
    assert np.abs(first.skin.vertices - small.case.skin.vertices).max() > 1.0
    np.testing.assert_array_equal(small.ending(two).skin.vertices, first.skin.vertices)
    after = small.case.planned_landmarks
    assert capsys.readouterr().out == ""
    other = replace(small.case, landmarks_after=Landmarks(after.names, after.points + 1.0))
    changed = Study(other, small.folder, make_mesh=small.make_mesh)
    for study, choices in ((small, replace(PAPERS, increments=3)), (changed, two)):
        study.ending(choices)
        assert "running" in capsys.readouterr().out


def test_every_choice_reaches_the_run(small: Study) -> None:
    """Each changes the skin, against the same run without it."""
    once = replace(PAPERS, increments=1)
    neo = replace(once, energy="neo-hookean")
    for choices, change in (
        (once, {"epsilon": 3.0}),
        (once, {"theta": 3.0}),
        (once, {"weights": "volume"}),
        (once, {"precision": "float64"}),
        (once, {"tolerance": 3.0}),
        (once, {"increments": 2}),
        (once, {"gravity": 9.81}),
        (replace(once, gravity=9.81), {"rest": "scan"}),
        (once, {"bones": "follow"}),
        (once, {"landmark_error": "each"}),
        (replace(once, landmark_error="each"), {"sample": 1}),
        (once, {"energy": "neo-hookean"}),
        (neo, {"poisson_ratio": 0.3}),
        (neo, {"skin_rigidity": 100.0}),
    ):
        other = small.ending(replace(choices, **change)).skin.vertices
        assert not np.array_equal(other, small.ending(choices).skin.vertices), change


def test_landmarks_of_a_plan_share_their_errors(small: Study) -> None:
    before, after = small.case.landmarks_before.points, small.case.planned_landmarks.points
    for sample in (0, 1):
        plan = small.landmarks(Choices(landmark_error="shared", sample=sample))
        for level in ("T4_", "T8_"):
            rows = [row for row, name in enumerate(small.case.landmarks_before.names) if name.startswith(level)]
            planned = fit_rigid(before[rows], after[rows])
            np.testing.assert_allclose(plan[1].points[rows], planned.apply(plan[0].points[rows]), atol=1e-9)
        each = small.landmarks(Choices(landmark_error="each", sample=sample))
        np.testing.assert_array_equal(each[0].points, plan[0].points)
        assert np.abs((each[1].points - after) - (each[0].points - before)).max() > 1.0
    assert small.landmarks(Choices())[0] is small.case.landmarks_before


def test_a_row_of_samples_has_their_mean_and_spread(small: Study) -> None:
    runs = tuple(Choices(increments=1, landmark_error="each", sample=sample) for sample in range(3))
    cost = measured(small, Row("landmarks", "input", Choices(), runs))
    away = [
        difference(small.ending(run).skin, small.ending(Choices()).skin, small.case.planned_landmarks).mean_mm
        for run in runs
    ]
    assert min(away) > 0.0
    assert cost.mean_mm == pytest.approx(np.mean(away))
    assert cost.spread["mean_mm"]["sd"] == pytest.approx(np.std(away, ddof=1))
    assert cost.samples == sum(cost.statuses.values()) == 3


def test_every_row_of_the_budget_varies_something() -> None:
    made = rows(3, 2)
    assert len({row.label for row in made}) == len(made)
    for row in made:
        assert len(set(row.runs)) == len(row.runs)
        assert row.against not in row.runs, row.label


def test_scripts(small: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Both write a table, a JSON without NaN and a picture, on a trunk of a few nodes."""
    map_constants.write_map(small, tmp_path / "docs" / "map", epsilons=(0.1, 1.0), thetas=(10.0,))
    error_budget.write_budget(small, rows(2, 1)[:2] + rows(2, 1)[-5:-2], tmp_path / "docs" / "budget")
    for name in ("map", "budget"):
        assert (tmp_path / "docs" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    found = json.loads((tmp_path / "docs" / "map.json").read_text())
    assert len(found["points"]) == 2 * 2
    nearest = found["best"]["weights count, nu 0.45, by mean distance"]["against"]["nu 0.45"]["mean_mm"]
    assert nearest == min(p["against"]["nu 0.45"]["mean_mm"] for p in found["points"] if p["weights"] == "count")
    costs = json.loads((tmp_path / "docs" / "budget.json").read_text())["rows"]
    assert [cost["bsr_deg"] for cost in costs] == sorted((cost["bsr_deg"] for cost in costs), reverse=True)
    for name in ("map", "budget"):
        assert f"({name}.png)" in (tmp_path / "docs" / f"{name}.md").read_text()
    shown = capsys.readouterr().out
    assert "| count | 0.1, 10 |" in shown
    assert costs[0]["label"] in shown
