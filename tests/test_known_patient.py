"""A patient whose numbers and sides are known by construction, as results, pages, pictures and files show her.

Texts of `tests/shown` hold every word, number and place of her pages and pictures. Tests here compare them with
the construction, not with the program, and with her mirror image, in which everything is on the other side and
nothing else is different.
"""

import csv
import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import warp_trunk.cli.measure as measure_command
from support.asserting import not_none
from support.drawn import Page, drawn_figures, pixels, place, side_at, slope_on_page
from support.known_patient import (
    ACTUAL,
    AFTER,
    BEFORE,
    PLAN,
    SD,
    Shape,
    exchange_sides,
    known_case,
    known_increments,
    known_intervals,
    known_part,
    write_known_result,
)
from support.known_spine import LEVELS
from support.rrd import column
from support.shown import check_shown, report_lines
from support.small_trunk import measured, start_recording
from warp_trunk.bone_motion.plan import plan_text
from warp_trunk.case.case import Study
from warp_trunk.case.layers import Layers
from warp_trunk.case.uncertainty import Invented, Uncertainty
from warp_trunk.cli import main
from warp_trunk.cohort import one_case
from warp_trunk.cohort.summary import errors
from warp_trunk.io.surface_files import write_surface
from warp_trunk.measures import measure
from warp_trunk.measures.quantities import QUANTITIES
from warp_trunk.results import read_result
from warp_trunk.results.summary_text import plain
from warp_trunk.run.intervals import spine_bands
from warp_trunk.run.sources import ErrorSource

STATES = {"before": BEFORE, "predicted": AFTER}
COBB = {"T1-T4": (20.0, 8.0), "T4-T11": (40.0, 17.0), "T11-L4": (32.0, 15.0)}
"""Angles before and after, the differences of the tilts."""
EXCHANGED = {"left_flank_mm": "right_flank_mm", "waist_depth_left_mm": "waist_depth_right_mm"}
SAME_ON_BOTH_SIDES = {
    "cobb_deg", "kyphosis_deg", "lordosis_deg", "spine_height_mm", "trunk_length_mm", "trunk_shift_forward_mm",
    "skin_change_max_mm", "skin_change_mean_mm",
}  # fmt: skip
"""Quantities without a side."""
RATIOS = {"waist_angle_ratio_percent", "waistline_depth_ratio_percent"}
"""Of one side to the other, in percent."""


@dataclass(frozen=True)
class Shown:
    """A result, the page of its report and its figures."""

    folder: Path
    page: Page
    figures: dict[str, Any]
    lines: list[str]
    """All of it as text, before other commands write into the folder."""


def shown(folder: Path, *options: str, page: str = "report.html", beside: Path | None = None) -> Shown:
    """The report of a result, or of two side by side."""
    with drawn_figures() as figures:
        assert main(["report", str(folder), *([str(beside)] if beside else []), *options]) == 0
    out = folder.parent if beside else folder
    read = Page((out / page).read_text(encoding="utf-8"))
    console = plain(read_result(folder)).replace(str(folder), "FOLDER").splitlines()
    return Shown(folder, read, figures, [*report_lines(read, figures), "== console", *console])


def sided(value: float) -> str:
    """A number as the program shows it: two digits, and its side."""
    size = abs(value)
    return f"{size:.{0 if size >= 9.95 else 1}f} {'right' if value > 0.0 else 'left'}"


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> list[Shown]:
    """The patient and her mirror image with a plan and intervals."""
    reports, folder = [], tmp_path_factory.mktemp("known")
    for name, mirrored in (("patient", False), ("mirror", True)):
        intervals = known_intervals(mirrored=mirrored)
        write_known_result(folder / name, mirrored=mirrored, intervals=intervals, plan_text=plan_text(PLAN))
        reports.append(shown(folder / name))
    return reports


@pytest.fixture(scope="module")
def patient(both: list[Shown]) -> Shown:
    return both[0]


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """Her result without intervals, with the skin that was scanned after surgery, and pictures without clothes."""
    folder = write_known_result(tmp_path_factory.mktemp("judged"), actual=ACTUAL)
    return shown(folder, "--views", "bare")


def test_a_report_with_intervals_and_a_plan_is_as_accepted(patient: Shown) -> None:
    check_shown("report_with_intervals", patient.lines)


def test_a_report_beside_the_actual_back_is_as_accepted(judged: Shown) -> None:
    check_shown("report", judged.lines)


def test_a_report_of_a_trunk_that_was_measured_in_part_is_as_accepted(tmp_path: Path) -> None:
    """Her front was not scanned, so that some levels have no hump, and the section at T1 lies above the scan, in
    which her left is red."""
    case = known_case()[0]
    colours = np.where(case.skin.vertices[:, :1] > 0.0, [200, 90, 80], [90, 90, 200]).astype(np.uint8)
    up = np.array([[0.0, 0.0, 80.0 * name.startswith("T1_")] for name in case.landmarks_before.names])
    before, after = (
        replace(marks, points=marks.points + up) for marks in (case.landmarks_before, case.planned_landmarks)
    )
    unseen = (case.skin.vertices[:, 1] < 0.0).astype(np.float64)
    folder = write_known_result(
        tmp_path,
        skin=replace(case.skin, colours=colours),
        landmarks_before=before,
        landmarks_after=after,
        unseen=unseen,
        invented=Invented(body="body 7", share=0.5),
    )
    check_shown("report_of_gaps", shown(folder).lines)


def test_a_report_of_a_part_is_as_accepted(tmp_path: Path) -> None:
    part = shown(write_known_result(tmp_path / "part", instead=known_part()[:2]))
    check_shown("report_of_part", part.lines)


def test_plans_side_by_side_are_as_accepted(patient: Shown, tmp_path: Path) -> None:
    """Plan A is hers, plan B changes nothing; A is better for the curve and worse for the lower back."""
    nothing = write_known_result(tmp_path / "nothing", BEFORE)
    own = write_known_result(tmp_path / "own", plan_text=plan_text(PLAN))
    check_shown("plans", shown(own, page="plans.html", beside=nothing).lines)


def known_numbers(shape: Shape, state: str) -> dict[tuple[str, str], float]:
    """Numbers of a state by quantity and level, positive to the right."""
    turned = shape.landmarks
    pedicles = {}
    for level in LEVELS:
        ends = [turned.point(f"{level}_{side}_pedicle_superior") for side in ("left", "right")]
        pedicles[level] = float(np.degrees(np.arctan2(ends[1][1] - ends[0][1], ends[0][0] - ends[1][0])))
    depths = {side: depth for side, (depth, _) in shape.waist.items()}
    place = {"before": 0, "predicted": 1}[state]
    return {
        **{("bsr_deg", level): angle for level, angle in shape.rotations.items()},
        **{("atr_deg", level): angle for level, angle in shape.rotations.items()},
        **{("hump_mm", level): hump for level, hump in shape.humps.items()},
        **{("axial_rotation_deg", level): angle for level, angle in pedicles.items()},
        **{("cobb_deg", ends): angles[place] for ends, angles in COBB.items()},
        ("main_hump_mm", "T8"): shape.humps["T8"],
        ("thoracic_bsr_deg", "T8"): shape.rotations["T8"],
        ("lumbar_bsr_deg", "L3"): shape.rotations["L3"],
        ("main_atr_deg", "T8"): shape.rotations["T8"],
        ("shoulder_difference_mm", ""): shape.shoulder_difference,
        ("waist_depth_mm", ""): depths["right"] - depths["left"],
        ("waist_depth_left_mm", ""): depths["left"],
        ("waist_depth_right_mm", ""): depths["right"],
        ("waist_height_mm", ""): shape.waist["right"][1] - shape.waist["left"][1],
    }


def numbers(folder: Path, state: str) -> dict[tuple[str, str], float]:
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return {(row["quantity"], row["level"]): row["value"] for row in summary["measures"] if row["state"] == state}


@pytest.mark.parametrize("state", STATES)
def test_every_number_is_that_of_the_construction_and_of_the_mirror_image_on_the_other_side(
    both: list[Shown], state: str
) -> None:
    own, mirrored = (numbers(each.folder, state) for each in both)
    expected = known_numbers(STATES[state], state)
    assert {name: own[name] for name in expected} == pytest.approx(expected, abs=0.05)
    twins = EXCHANGED | {other: name for name, other in EXCHANGED.items()}
    wanted = {}
    for (quantity, level), value in own.items():
        size = None if value is None else 1e4 / value if quantity in RATIOS else value
        has_side = quantity not in SAME_ON_BOTH_SIDES | RATIOS and quantity not in twins
        assert QUANTITIES[quantity].side == has_side, quantity
        wanted[twins.get(quantity, quantity), level] = -size if has_side and size is not None else size
    assert mirrored == pytest.approx(wanted, abs=2e-3)


def test_nothing_but_the_side_is_different_in_the_mirror_image(both: list[Shown]) -> None:
    """Rows of numbers, but for ratios of one side to the other, words at their places in pictures, and pixels."""
    own, mirrored = (each.page.rows for each in both)
    shared = [title for title in own if "ratio" not in title and "time" not in title.lower()]
    assert len(shared) > 50
    for title in shared:
        cells, twins = own[title], mirrored.get(exchange_sides(title), mirrored.get(title, [title]))
        wanted = [exchange_sides(cell) for cell in cells]
        assert [" to ".join(sorted(cell.split(" to "))) for cell in twins] == [
            " to ".join(sorted(cell.split(" to "))) for cell in wanted
        ], title
    for name, figure in both[0].figures.items():
        across = -1.0 if name in ("back", "hump", "front", "shoulders", "spine_behind", "likely") else 1.0
        for axes, other in zip(figure.axes, both[1].figures[name].axes, strict=True):
            if across < 0.0:
                texts = [
                    (exchange_sides(text.get_text()), *text.get_position())
                    for text in axes.texts
                    if text.get_transform() == axes.transData and not text.get_text().startswith(("100", "50 "))
                ]
                twins = {text.get_text(): text.get_position() for text in other.texts}
                for words, x, z in texts:
                    assert twins[words] == pytest.approx((-x, z), abs=3.0), (name, words)
            if axes.images and across < 0.0:
                image, twin = (pixels(panel) for panel in (axes, other))
                assert np.mean(np.abs(image - twin[:, ::-1]) > 0.02) < 0.02, name
                assert np.mean(np.abs(image - twin) > 0.02) > 0.02, name


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["patient", "mirror image"])
def test_surgery_that_achieves_less_leaves_more_of_the_curve_and_of_its_rotation(sign: float) -> None:
    """A hundredth of the way back to before; an angle between endplates has no side, a rotation has one."""
    case = replace(
        known_case(mirrored=sign < 0.0)[0], uncertainty=Uncertainty(landmark_error=0.0, landmark_error_sd=0.0)
    )
    back = 0.01 * (case.landmarks_before.points - case.planned_landmarks.points)
    rows, effects, _ = spine_bands(
        case, [ErrorSource("amount", "1 %", "none", of_surgery=True, landmarks_after=back)]
    )
    by_name = {(row.quantity, row.level): effect for row, (effect,) in zip(rows, effects, strict=True)}
    for ends, (was, will) in COBB.items():
        assert by_name["cobb_deg", ends] == pytest.approx(0.01 * (was - will), rel=0.1)
    for apex, change in (("T7", 6.0), ("L1", -4.0 / 3.0)):
        assert by_name["apical_rotation_deg", apex] == pytest.approx(sign * 0.01 * change, rel=0.02)


def test_console_tables_and_csv_have_every_level_with_its_number_and_side(
    judged: Shown, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    console = {
        line.split()[0]: line.split()[1:] for line in plain(read_result(judged.folder)).splitlines() if line
    }
    assert main(["measure", str(judged.folder), "--out", str(tmp_path / "m")]) == 0
    assert "Main hump, at T8" in capsys.readouterr().out  # as the file has it, though L3 has more
    with (tmp_path / "m.csv").open(encoding="utf-8") as file:
        rows = {
            (row["quantity"], row["level"]): float(row["value"]) for row in csv.DictReader(file) if row["value"]
        }
    for level in LEVELS:
        was, will, really = (shape.rotations[level] for shape in (BEFORE, AFTER, ACTUAL))
        assert " ".join(console[level]).startswith(f"{sided(was)} {sided(will)}")
        cells = judged.page.rows[level]
        assert [*cells[:2], cells[3]] == [sided(value) for value in (was, will, really)]
        assert cells[2].split()[-1] == ("better" if abs(will) < abs(was) else "worse")
        assert float(cells[4]) == pytest.approx(abs(will - really), abs=0.06)
        assert rows["bsr_deg", level] == pytest.approx(will, abs=0.05)
        assert rows["hump_mm", level] == pytest.approx(AFTER.humps[level], abs=0.05)
    for part, levels in (("T3-T12", LEVELS[2:12]), ("L1-L5", LEVELS[12:])):
        (mean,) = judged.page.rows[f"Rotation of the back, mean absolute error {part} [°]"]
        errors_of_part = [abs(AFTER.rotations[level] - ACTUAL.rotations[level]) for level in levels]
        assert float(mean.split(" ± ")[0]) == pytest.approx(np.mean(errors_of_part), abs=0.03)


def test_likely_backs_stand_beside_the_prediction_better_first(both: list[Shown]) -> None:
    """The hump of the worse one is larger, on the side on which it is."""
    for each, side in zip(both, ("right", "left"), strict=True):
        panels = each.figures["likely"].axes[:3]
        (texts,) = zip(
            *([text for text in axes.texts if "T8:" in text.get_text()][:1] for axes in panels), strict=True
        )
        sizes = [float(text.get_text().split()[1]) for text in texts]
        assert sizes == sorted(sizes)
        assert sizes[1] == pytest.approx(AFTER.humps["T8"], abs=0.6)
        assert sizes[2] - sizes[0] > 2.0
        assert [
            side_at(axes, place(axes, *text.get_position())[0]) for axes, text in zip(panels, texts, strict=True)
        ] == [side] * 3


def test_pictures_show_shoulders_and_hump_at_their_place_and_side(judged: Shown) -> None:
    for number, shape in enumerate(STATES.values()):
        axes = judged.figures["shoulders"].axes[number]
        heights = {}
        for bar in (line for line in axes.lines if line.get_linewidth() == 2.2):
            (side,) = {side_at(axes, place(axes, x, 0.0)[0]) for x in bar.get_xdata()}  # on one side of the neck
            heights[side] = float(bar.get_ydata()[0])
        assert heights["right"] - heights["left"] == pytest.approx(shape.shoulder_difference, abs=0.1)
        axes = judged.figures["hump"].axes[number]
        levels = ["T8", "L3"][: number + 1]
        texts = [text for text in axes.texts if re.match(r"\w+: ", text.get_text())]
        assert [t.get_text() for t in texts] == [f"{at}: {abs(shape.humps[at]):.0f} mm" for at in levels]
        for text, level in zip(texts, levels, strict=True):
            x, z = text.get_position()
            height = shape.landmarks.of_bone(level).points[:, 2].mean()
            assert z - 20.0 == pytest.approx(height, abs=0.1)
            assert side_at(axes, place(axes, x, z)[0]) == sided(shape.humps[level]).split()[1]
            across, up = place(axes, 0.5 * x, height)
            image = pixels(axes)
            red, _, blue = image[int((1.0 - up) * len(image)), int(across * image.shape[1]), :3]
            assert red > blue + 0.1  # orange: further back


def test_every_section_is_that_of_its_level_and_is_turned_as_its_words_say(both: list[Shown]) -> None:
    """Half of an interval is 2.9 degrees: more than the change and the size of T1's 1.1, less than T8's 7.3."""
    for sign, each in zip((1.0, -1.0), both, strict=True):
        panels = [axes for axes in each.figures["sections"].axes if axes.get_title(loc="left")]
        assert [axes.get_title(loc="left") for axes in panels] == list(LEVELS)
        for axes in panels:
            level = axes.get_title(loc="left")
            angles = [sign * shape.rotations[level] for shape in STATES.values()]
            words = axes.get_title(loc="right").split(" → ")
            is_sure = max(abs(angles[0] - angles[1]), abs(angles[1])) > 1.96 * SD
            assert words == [sided(angles[0]), sided(angles[1]) if is_sure else "not known"]
            tangents = [line for line in axes.lines if line.get_linewidth() == 1.3]
            slopes = [slope_on_page(axes, line.get_xydata()) for line in tangents]  # the back is below
            np.testing.assert_allclose(slopes, angles, atol=0.05)
            x = next(line for line in axes.lines if line.get_linewidth() == 0.8).get_xdata()
            reach = {side_at(axes, place(axes, end, 0.0)[0]): abs(end) for end in (x.min(), x.max())}
            z = float(BEFORE.landmarks.of_bone(level).points[:, 2].mean())
            for side in ("left", "right"):
                own = side if sign > 0.0 else exchange_sides(side)
                assert reach[own] == pytest.approx(float(BEFORE.flank(side, z)), abs=0.1)


def test_the_recording_of_the_mirror_image_is_on_the_other_side(tmp_path: Path) -> None:
    """Words, tangents of the section and skin; the text of `tests/recording` has the patient's."""
    texts = []
    for sign in (1.0, -1.0):
        case, mesh, displacement = known_case(mirrored=sign < 0.0)
        path = tmp_path / f"{sign}.rrd"
        with start_recording(path, case, mesh) as recording:
            for increment in known_increments(displacement, mesh):
                recording.increment(increment, measured(case, mesh, increment))
        words = [column(path, f"/{name}", "labels")[2].tolist() for name in ("bars/angles", "section/now/angle")]
        texts.append(exchange_sides(str(words)) if sign > 0.0 else str(words))
        (x, y), (u, v) = sorted(column(path, "/section/now", "strips")[2][1].tolist())  # to the right and down
        assert np.degrees(np.arctan2(v - y, u - x)) == pytest.approx(sign * AFTER.rotations["T8"], abs=0.05)
        skin = column(path, "/now/skin", "vertex_positions")[2]
        np.testing.assert_allclose(skin, case.skin.vertices + displacement[mesh.skin_nodes], atol=1e-3)
        sides = [column(path, "/sides", part)[None].tolist() for part in ("labels", "positions")]
        assert [name for name, (x, *_) in zip(*sides, strict=True) if x > 0.0] == ["left"]
    assert texts[0] == texts[1]


def test_files_for_other_programs_hold_shape_displacement_and_layers(tmp_path: Path) -> None:
    """Fat on her left above the loin, skin on top, muscle elsewhere, read by trimesh, VTK and as Abaqus' text."""
    pyvista = pytest.importorskip("pyvista")
    case, mesh, displacement = known_case()
    centres = mesh.nodes[mesh.tets].mean(axis=1)
    fat = (centres[:, 0] > 20.0) & (centres[:, 2] > 100.0)
    labels = np.where(centres[:, 2] > 430.0, 0, np.where(fat, 1, 2)).astype(np.int8)
    layered = replace(case, layers=Layers(constants={"fat": {"youngs_modulus": 3.5}}))
    write_known_result(tmp_path / "result", instead=(layered, replace(mesh, tissue=labels)))
    summary = json.loads((tmp_path / "result" / "summary.json").read_text(encoding="utf-8"))
    assert [tissue["youngs_modulus"] for tissue in summary["tissues"]] == [130.0, 3.5, 10.0]
    for name in ("skin.glb", "tissue.vtu", "tissue.inp"):
        assert main(["export", str(tmp_path / "result"), "--out", str(tmp_path / name)]) == 0
    scene: Any = trimesh.load(tmp_path / "skin.glb", process=False, force="mesh")
    x, y, z = case.skin.vertices.T / 1000.0
    np.testing.assert_allclose(scene.vertices, np.column_stack([x, z, -y]), atol=1e-6)  # metres, y up, z forward
    grid: Any = pyvista.read(tmp_path / "tissue.vtu")
    np.testing.assert_allclose(grid.points, mesh.nodes, atol=1e-4)
    np.testing.assert_array_equal(grid.cells_dict[pyvista.CellType.TETRA], mesh.tets)
    (name,) = (name for name in grid.point_data if grid.point_data[name].ndim == 2)
    on_bone = mesh.prescribed
    np.testing.assert_allclose(grid.point_data[name][on_bone], displacement[on_bone], atol=1e-4)
    tets = grid.extract_cells(grid.celltypes == pyvista.CellType.TETRA)
    assert tets.compute_cell_sizes(length=False, area=False)["Volume"].min() > 0.0
    np.testing.assert_allclose(tets.cell_centers().points, centres, atol=1e-4)
    np.testing.assert_array_equal(tets.cell_data["tissue"], labels)
    deck = (tmp_path / "tissue.inp").read_text(encoding="utf-8").upper()
    moduli = re.findall(r"\*MATERIAL, NAME=.*\n\*ELASTIC\n([^,]+),", deck)
    assert sorted(map(float, moduli)) == pytest.approx([0.0035, 0.01, 0.13])  # MPa


def test_a_second_skin_is_compared_with_its_warnings(
    judged: Shown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(measure_command, "arm_warnings", lambda *_: ["It has an arm."])
    write_surface(tmp_path / "actual.ply", not_none(known_case(actual=ACTUAL)[0].actual_skin))
    words = ["--against", str(tmp_path / "actual.ply"), "--out", str(tmp_path)]
    assert main(["measure", str(judged.folder), *words]) == 0
    said = capsys.readouterr()
    assert "warp-trunk: warning: It has an arm." in said.err.splitlines()
    assert "Error of the back surface rotation, predicted against actual" in said.out


def test_the_baseline_of_a_cohort_is_measured_with_the_landmarks_after_surgery() -> None:
    """Where surgery turns the whole of her, the spline carries her skin along, and no rotation changes."""
    case = known_case()[0]
    turn = Rotation.from_euler("z", 12.0, degrees=True)
    turned = replace(case.landmarks_before, points=turn.apply(case.landmarks_before.points + 30.0))
    carried = one_case._carried(replace(case, landmarks_after=turned), measure(case.skin, case.landmarks_before))
    rotations = {row.level: row.value for row in carried if row.quantity == "bsr_deg"}
    assert rotations == pytest.approx(BEFORE.rotations, abs=0.05)


def test_the_row_of_a_cohort_has_her_numbers(judged: Shown, tmp_path: Path) -> None:
    study = Study(patient="P7", pose="bending", months_after=6.0, synthetic=True)
    case = replace(known_case(actual=ACTUAL)[0], study=study)
    row = one_case._row(case, tmp_path / "folder", read_result(judged.folder))
    assert (row.folder, row.patient, row.case, row.status) == ("folder", "P7", "known patient", "CONVERGED")
    assert (row.synthetic, row.months_after, row.pose) == (True, 6.0, "bending")
    assert row.cobb_deg == pytest.approx(40.0)
    assert row.correction_percent == pytest.approx(100.0 * (1.0 - 17.0 / 40.0))
    assert row.tets == len(known_case()[1].tets)
    rotations = {(each.state, each.level): each.value for each in row.measures if each.quantity == "bsr_deg"}
    for state, shape in (("before", BEFORE), ("predicted", AFTER), ("actual", ACTUAL)):
        own = {level: rotations[state, level] for level in LEVELS}
        assert own == pytest.approx(shape.rotations, abs=0.06), state
    of_levels = dict(errors([row]).filter(guess="predicted").select("level", "error").rows())
    wanted = {level: AFTER.rotations[level] - ACTUAL.rotations[level] for level in LEVELS}
    assert of_levels == pytest.approx(wanted, abs=0.06)
