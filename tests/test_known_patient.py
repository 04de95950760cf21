"""A patient whose numbers and sides are known by construction, as results, pages, pictures and files show her.

Every output is read back as a person or another program reads it, and compared with the construction, not with
the program. Her mirror image has everything on the other side, and nothing else is different.
"""

import csv
import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import meshio
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
    MIRROR,
    Shape,
    exchange_sides,
    known_case,
    known_increments,
    write_known_result,
)
from support.known_spine import LEVELS
from support.rrd import column
from support.shown import check_shown, report_lines
from support.small_trunk import measured, start_recording
from warp_trunk.case.case import Study
from warp_trunk.case.layers import Layers
from warp_trunk.case.uncertainty import Uncertainty
from warp_trunk.cli import main
from warp_trunk.cohort import one_case
from warp_trunk.cohort.summary import errors
from warp_trunk.io.surface_files import write_surface
from warp_trunk.measures import measure
from warp_trunk.measures.measures import measure_level
from warp_trunk.measures.quantities import ACTUAL as ACTUAL_STATE
from warp_trunk.measures.quantities import BEFORE as BEFORE_STATE
from warp_trunk.measures.quantities import BETTER, EXACT, PREDICTED, QUANTITIES, WORSE, Measured
from warp_trunk.recording.numbers import side_by_side
from warp_trunk.results import read_result
from warp_trunk.results.bands import Bands, BandSource, Effects, FoundBands
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
    sign: float
    """1, or -1 of the mirror image."""
    page: Page
    figures: dict[str, Any]

    def words(self, text: str) -> str:
        """A text about the patient as it is about this one."""
        return text if self.sign > 0.0 else exchange_sides(text)

    def side(self, value: float) -> str:
        return "right" if self.sign * value > 0.0 else "left"

    def sided(self, value: float) -> str:
        """A number as the program shows it: two digits, and its side."""
        size = abs(value)
        return f"{size:.{0 if size >= 9.95 else 1}f} {self.side(value)}"


def shown(folder: Path, sign: float) -> Shown:
    write_known_result(folder, mirrored=sign < 0.0)
    with drawn_figures() as figures:
        assert main(["report", str(folder)]) == 0
    return Shown(folder, sign, Page((folder / "report.html").read_text(encoding="utf-8")), figures)


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Shown, Shown]:
    folder = tmp_path_factory.mktemp("known")
    return shown(folder / "patient", 1.0), shown(folder / "mirror", -1.0)


@pytest.fixture(params=[0, 1], ids=["patient", "mirror image"])
def patient(both: tuple[Shown, Shown], request: pytest.FixtureRequest) -> Shown:
    return both[request.param]


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
def test_the_summary_has_the_numbers_of_the_construction(both: tuple[Shown, Shown], state: str) -> None:
    shown, expected = numbers(both[0].folder, state), known_numbers(STATES[state], state)
    assert {name: shown[name] for name in expected} == pytest.approx(expected, abs=0.05)
    assert read_result(both[0].folder).summary.has_spine is True
    lumbar = {name: value for name, value in shown.items() if name[0] == "bsr_deg" and name[1].startswith("L")}
    assert max(lumbar.values()) < 0.0 < shown["bsr_deg", "T8"]


@pytest.mark.parametrize("state", STATES)
def test_the_mirror_image_has_every_number_on_the_other_side(both: tuple[Shown, Shown], state: str) -> None:
    own, mirrored = (numbers(patient.folder, state) for patient in both)
    assert own.keys() == mirrored.keys()
    twins = EXCHANGED | {other: name for name, other in EXCHANGED.items()}
    wanted = {}
    for (quantity, level), value in own.items():
        size = None if value is None else 1e4 / value if quantity in RATIOS else value
        has_side = quantity not in SAME_ON_BOTH_SIDES | RATIOS and quantity not in twins
        assert QUANTITIES[quantity].side == has_side, quantity
        wanted[twins.get(quantity, quantity), level] = -size if has_side and size is not None else size
    assert mirrored == pytest.approx(wanted, abs=2e-3)


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


def test_the_console_has_every_level_with_its_side(patient: Shown) -> None:
    rows = {line.split()[0]: line.split()[1:] for line in plain(read_result(patient.folder)).splitlines() if line}
    for level in LEVELS:
        wanted = [patient.sided(shape.rotations[level]) for shape in STATES.values()]
        assert " ".join(rows[level]) == " ".join(wanted)
    written = next(" ".join(words) for word, words in rows.items() if word == "Written")
    assert {"summary.json,", "predicted_skin.ply,"} <= set(written.split())
    result = read_result(patient.folder)
    table = side_by_side(result.table, result.measures_before, (BEFORE_STATE, PREDICTED), 1.0)
    assert "Actual" not in table
    assert "Actual: the skin after" in side_by_side(
        result.table, result.measures_before, (BEFORE_STATE, ACTUAL_STATE), 1.0
    )


def test_the_table_of_measures_has_the_known_numbers(
    patient: Shown, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["measure", str(patient.folder), "--out", str(tmp_path / "m")]) == 0
    assert "Main hump, at T8" in capsys.readouterr().out  # as the file has it, though L3 has more
    with (tmp_path / "m.csv").open(encoding="utf-8") as file:
        rows = {
            (row["quantity"], row["level"]): float(row["value"]) for row in csv.DictReader(file) if row["value"]
        }
    for level in LEVELS:
        assert rows["bsr_deg", level] == pytest.approx(patient.sign * AFTER.rotations[level], abs=0.05)
        assert rows["hump_mm", level] == pytest.approx(patient.sign * AFTER.humps[level], abs=0.05)
    assert rows["main_hump_mm", "T8"] == pytest.approx(patient.sign * AFTER.humps["T8"], abs=0.05)


def test_the_page_says_which_side_and_how_much(patient: Shown) -> None:
    hump, lumbar = ([abs(shape.humps[level]) for shape in STATES.values()] for level in ("T8", "L3"))
    shoulders = [shape.shoulder_difference for shape in STATES.values()]
    for text in (
        "20 → 12 mm waist, height, the left one higher",
        "15 → 7 mm waist, depth, the left one deeper",
        f"{hump[0]:.0f} → {hump[1]:.0f} mm hump at T8, on the right",
        f"{shoulders[0]:.0f} → {shoulders[1]:.0f} mm shoulders, the right one higher",
        "14 → 7° rotation of the back at T8, the right side further back",
        "The waist is 12 mm higher on the left instead of 20 mm higher on the left and 7 mm deeper on the left "
        "instead of 15 mm deeper on the left",
        f"the hump at T8 is {hump[1]:.0f} mm (right) instead of {hump[0]:.0f} mm (right), now largest at L3, "
        f"{lumbar[1]:.0f} mm",
        f"The shoulders differ in height by {shoulders[1]:.0f} mm (the right one higher) instead of "
        f"{shoulders[0]:.0f} mm (the right one higher)",
        "orse at another level: hump",  # it grows to more at L3 than it was at T8
        "The left side of the back still stands further back, by 15 degrees at vertebra L3.",
        "from 20 to 8 degrees (T1 to T4, to the left), from 40 to 17 degrees (T4 to T11, to the right) and "
        "from 32 to 15 degrees (T11 to L4, to the left)",
    ):
        assert patient.words(text) in patient.page.words


def test_the_tables_of_the_page_have_the_numbers_of_their_level(patient: Shown) -> None:
    rows = patient.page.rows
    for level in LEVELS:
        was, will = (shape.rotations[level] for shape in STATES.values())
        assert rows[level][:2] == [patient.sided(was), patient.sided(will)]
        assert rows[level][2].split()[-1] == ("better" if abs(will) < abs(was) else "worse")
    for title, cells in {
        "Higher waist, by [mm]": ["20 left", "12 left", "8.0 better"],
        "Deeper waist, by [mm]": ["15 left", "7.0 left", "8.0 better"],
        "Depth of the left waist [mm]": ["24", "15", "9.0 less"],
        "Depth of the right waist [mm]": ["9.0", "8.0", "1.0 less"],
        "Rotation of the lower back (BSR) at L3 [°]": ["9.4 left", "15 left", "5.6 worse"],
        "Cobb angle T4 to T11 [°]": ["40", "17", "23 better"],
    }.items():
        assert rows[patient.words(title)] == [patient.words(cell) for cell in cells]


def test_nothing_else_on_the_page_depends_on_the_side(both: tuple[Shown, Shown]) -> None:
    """Rows of numbers, but for ratios of one side to the other."""
    own, mirrored = (patient.page.rows for patient in both)
    shared = [title for title in own if "ratio" not in title and "time" not in title.lower()]
    assert len(shared) > 50
    for title in shared:
        cells = [exchange_sides(cell) for cell in own[title]]
        assert mirrored.get(exchange_sides(title), mirrored.get(title)) == cells, title


def test_the_picture_of_the_shoulders_shows_the_higher_one_on_its_side(patient: Shown) -> None:
    for axes, shape in zip(patient.figures["shoulders"].axes, STATES.values(), strict=True):
        heights = {}
        for bar in (line for line in axes.lines if line.get_linewidth() == 2.2):
            across, _ = place(axes, float(np.mean(bar.get_xdata())), 0.0)
            heights[side_at(axes, across)] = float(bar.get_ydata()[0])
            sides = {side_at(axes, place(axes, x, 0.0)[0]) for x in bar.get_xdata()}
            assert len(sides) == 1  # from 0.6 to 0.8 of the way to one edge
        assert heights["right"] - heights["left"] == pytest.approx(
            patient.sign * shape.shoulder_difference, abs=0.1
        )
        (words,) = (text.get_text() for text in axes.texts if "shoulder" in text.get_text())
        assert words == patient.words(f"right shoulder\n{shape.shoulder_difference:.0f} mm higher")


@pytest.mark.parametrize("name", ["back", "hump", "front", "shoulders"])
def test_pictures_of_the_mirror_image_are_mirrored(both: tuple[Shown, Shown], name: str) -> None:
    for own, mirrored in zip(*(patient.figures[name].axes for patient in both), strict=True):
        if own.images:
            image, other = (pixels(axes) for axes in (own, mirrored))
            assert np.mean(np.abs(image - other[:, ::-1]) > 0.02) < 0.02
            assert np.mean(np.abs(image - other) > 0.02) > 0.02


@pytest.mark.parametrize("name", ["back", "front"])
def test_the_deeper_waist_is_on_its_side_in_the_pictures(patient: Shown, name: str) -> None:
    for axes, shape in zip(patient.figures[name].axes, STATES.values(), strict=True):
        outline = pixels(axes)[:, :, 3] > 0.5
        widths = {}
        for side in ("left", "right"):
            _, up = place(axes, 0.0, shape.waist[side][1])
            row = np.flatnonzero(outline[int((1.0 - up) * len(outline))]) + 0.5
            edges = [place_of_pixel / outline.shape[1] for place_of_pixel in (row.min(), row.max())]
            edge = next(candidate for candidate in edges if side_at(axes, candidate) == patient.words(side))
            widths[side] = abs(edge - 0.5) * abs(np.subtract(*axes.get_xlim()))
        wanted = shape.waist["left"][0] - shape.waist["right"][0]
        assert widths["right"] - widths["left"] == pytest.approx(wanted, abs=4.0)


def test_every_section_is_that_of_its_level_and_is_turned_as_its_words_say(patient: Shown) -> None:
    panels = [axes for axes in patient.figures["sections"].axes if axes.get_title(loc="left")]
    assert [axes.get_title(loc="left") for axes in panels] == list(LEVELS)
    for axes in panels:
        level = axes.get_title(loc="left")
        angles = [shape.rotations[level] for shape in STATES.values()]
        assert axes.get_title(loc="right") == " → ".join(map(patient.sided, angles))
        assert (side_at(axes, 0.0), side_at(axes, 1.0)) == ("left", "right")
        tangents = [line for line in axes.lines if line.get_linewidth() == 1.3]
        slopes = [slope_on_page(axes, line.get_xydata()) for line in tangents]  # the back is below
        np.testing.assert_allclose(slopes, patient.sign * np.array(angles), atol=0.05)
        contour = next(line for line in axes.lines if line.get_linewidth() == 0.8).get_xydata()
        reach = {side_at(axes, place(axes, x, 0.0)[0]): abs(x) for x in (contour[:, 0].min(), contour[:, 0].max())}
        z = float(BEFORE.landmarks.of_bone(level).points[:, 2].mean())
        for side in ("left", "right"):
            assert reach[patient.words(side)] == pytest.approx(float(BEFORE.flank(side, z)), abs=0.1)


def test_the_hump_is_ringed_at_its_level_and_side_and_coloured_there(patient: Shown) -> None:
    for axes, shape, levels in zip(
        patient.figures["hump"].axes, STATES.values(), (["T8"], ["T8", "L3"]), strict=False
    ):
        texts = [text for text in axes.texts if text.get_text().endswith("mm") and ":" in text.get_text()]
        assert [text.get_text() for text in texts] == [
            f"{level}: {abs(shape.humps[level]):.0f} mm" for level in levels
        ]
        image = pixels(axes)
        for text, level in zip(texts, levels, strict=True):
            x, z = text.get_position()
            height = shape.landmarks.of_bone(level).points[:, 2].mean()
            assert z - 20.0 == pytest.approx(height, abs=0.1)
            assert side_at(axes, place(axes, x, z)[0]) == patient.side(shape.humps[level])
            across, up = place(axes, 0.5 * x, height)
            rows, columns = image.shape[:2]
            red, _, blue = image[int((1.0 - up) * rows), int(across * columns), :3]
            assert red > blue + 0.1  # orange: further back


def test_the_spine_has_each_level_at_its_place_and_each_angle_in_its_hollow(patient: Shown) -> None:
    for number, (axes, shape) in enumerate(
        zip(patient.figures["spine_behind"].axes, STATES.values(), strict=True)
    ):
        texts = {text.get_text(): text.get_position() for text in axes.texts}
        for level in LEVELS:
            centre = shape.landmarks.of_bone(level).points.mean(axis=0)
            x, z = texts[level]
            assert x == pytest.approx(patient.sign * centre[0], abs=4.0)
            assert z == pytest.approx(centre[2], abs=6.0)
        for ends, hollow in (("T4-T11", "left"), ("T11-L4", "right")):
            x, z = texts[f"{COBB[ends][number]:.0f}°"]
            upper, lower = (texts[level] for level in ends.split("-"))
            assert lower[1] < z < upper[1]
            left_of_spine = place(axes, x, z)[0] < place(axes, (upper[0] + lower[0]) / 2.0, z)[0]
            assert left_of_spine == (patient.words(hollow) == "left")


def test_the_plot_of_rotations_has_every_level_at_its_name(patient: Shown) -> None:
    (axes,) = patient.figures["rotation"].axes
    assert [label.get_text() for label in axes.get_yticklabels()] == list(LEVELS)
    lines = {str(line.get_label()): line for line in axes.lines}
    for title, shape in (("before surgery", BEFORE), ("predicted", AFTER)):
        wanted = patient.sign * np.array([*shape.rotations.values()])
        np.testing.assert_allclose(lines[title].get_xdata(), wanted, atol=0.05)
        np.testing.assert_array_equal(lines[title].get_ydata(), range(len(LEVELS)))
    left, right = axes.get_xlabel().split("back surface rotation")
    assert ("left side" in left, "right side" in right) == (True, True)
    assert place(axes, -1.0, 0.0)[0] < place(axes, 1.0, 0.0)[0]


def test_files_for_other_programs_hold_the_shape_in_their_unit(patient: Shown, tmp_path: Path) -> None:
    case, mesh, displacement = known_case(mirrored=patient.sign < 0.0)
    assert main(["export", str(patient.folder), "--out", str(tmp_path / "skin.glb")]) == 0
    scene: Any = trimesh.load(tmp_path / "skin.glb", process=False, force="mesh")
    x, y, z = case.skin.vertices.T / 1000.0
    np.testing.assert_allclose(
        scene.vertices, np.column_stack([x, z, -y]), atol=1e-6
    )  # metres, y up, z to the front
    assert main(["export", str(patient.folder), "--out", str(tmp_path / "tissue.vtu")]) == 0
    tissue: Any = meshio.read(tmp_path / "tissue.vtu")
    np.testing.assert_allclose(tissue.points, mesh.nodes, atol=1e-4)
    (moved,) = (data for data in tissue.point_data.values() if data.ndim == 2 and data.shape[1] == 3)
    on_bone = np.abs(moved).sum(axis=1) > 0.0
    np.testing.assert_allclose(moved[on_bone], displacement[on_bone], atol=1e-4)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["patient", "mirror image"])
def test_the_recording_has_every_level_and_its_section_is_turned_as_its_words_say(
    tmp_path: Path, sign: float
) -> None:
    case, mesh, displacement = known_case(mirrored=sign < 0.0)
    recording = start_recording(tmp_path / "known.rrd", case, mesh)
    for increment in known_increments(displacement, mesh):
        recording.increment(increment, measured(case, mesh, increment))
    recording.close()

    def sided(value: float) -> str:
        size = f"{abs(value):.{0 if abs(value) >= 9.95 else 1}f}"
        return f"{size} {'right' if sign * value > 0.0 else 'left'}"

    said = column(tmp_path / "known.rrd", "/bars/angles", "labels")
    names_of_rows = column(tmp_path / "known.rrd", "/bars/levels", "labels")[None].tolist()
    assert {"T1", "T8"} < set(names_of_rows)
    for number, shape in ((0, BEFORE), (2, AFTER)):
        assert said[number].tolist() == [sided(shape.rotations[level]) for level in names_of_rows]
        words = column(tmp_path / "known.rrd", "/section/now/angle", "labels")[number]
        assert words.tolist() == [f"now {sided(shape.rotations['T8'])}"]
        _, tangent = column(tmp_path / "known.rrd", "/section/now", "strips")[number]
        (x, y), (u, v) = sorted(tangent.tolist())  # two dimensions: to the right and down
        assert np.degrees(np.arctan2(v - y, u - x)) == pytest.approx(sign * shape.rotations["T8"], abs=0.05)
    names = column(tmp_path / "known.rrd", "/sides", "labels")[None].tolist()
    where = column(tmp_path / "known.rrd", "/sides", "positions")[None]
    assert dict(zip(names, where[:, 0] > 0.0, strict=True)) == {"left": True, "right": False}
    skins = column(tmp_path / "known.rrd", "/now/skin", "vertex_positions")
    np.testing.assert_allclose(skins[2], case.skin.vertices + displacement[mesh.skin_nodes], atol=1e-3)
    own, _, other = known_case(mirrored=sign > 0.0)
    assert not np.allclose(np.sort(skins[2][:, 0]), np.sort((own.skin.vertices + other[mesh.skin_nodes])[:, 0]))
    assert np.allclose(MIRROR * own.skin.vertices, case.skin.vertices)


def test_plans_side_by_side_have_their_own_numbers_as_accepted(both: tuple[Shown, Shown], tmp_path: Path) -> None:
    """Plan A is hers, plan B changes nothing; A is better for the curve and worse for the lower back."""
    nothing = write_known_result(tmp_path / "nothing", BEFORE)
    with drawn_figures() as figures:
        assert main(["report", str(both[0].folder), str(nothing), "--out", str(tmp_path)]) == 0
    page = Page((tmp_path / "plans.html").read_text(encoding="utf-8"))
    assert "Cobb angle T4 to T11: 17° with plan A and 40° with plan B." in page.words
    titles = [axes.get_title() for axes in figures["hump"].axes[:3]]
    assert titles == ["Before surgery", "Plan A", "Plan B"]
    (axes,) = figures["rotation"].axes
    lines = {str(line.get_label()): line.get_xdata() for line in axes.lines}
    np.testing.assert_allclose(lines["plan A"], [*AFTER.rotations.values()], atol=0.05)
    np.testing.assert_allclose(lines["plan B"], [*BEFORE.rotations.values()], atol=0.05)
    check_shown("plans", report_lines(page, figures))


SD = 1.5
"""Of every rotation in the intervals below [degrees]."""


@pytest.fixture(scope="module", params=[1.0, -1.0], ids=["patient", "mirror image"])
def sure(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Shown:
    """Her result with intervals of a standard deviation, and a skin of which 2 mm are not known at the right."""
    sign, folder = request.param, tmp_path_factory.mktemp("sure")
    case, mesh, displacement = known_case(mirrored=sign < 0.0)
    rows = [
        Measured.with_sd(state, level, "bsr_deg", sign * angle, SD if state == PREDICTED else SD / 3.0)
        for state in (PREDICTED, EXACT)
        for level, angle in AFTER.rotations.items()
    ]
    rows += [
        Measured.with_sd(PREDICTED, "T8", key, sign * AFTER.humps["T8"], 2.0)
        for key in ("hump_mm", "main_hump_mm")
    ]
    skin = case.skin.moved(case.skin.vertices + displacement[mesh.skin_nodes])
    further = np.outer(sign * skin.vertices[:, 0] < 0.0, [0.0, 2.0, 0.0]) * (skin.vertices[:, 1:2] > 0.0)
    likely = {
        state: measure_level(skin.moved(skin.vertices + way * further), case.planned_landmarks, "T8")
        for state, way in ((BETTER, -1.0), (WORSE, 1.0))
    }
    effects = Effects(
        names=np.array([(row.quantity, row.level) for row in rows if row.state == PREDICTED]),
        sources=np.array(["amount of correction"]),
        effects=np.ones((len(LEVELS) + 2, 1)),
        landmarks=np.zeros((len(LEVELS) + 2, 6)),
        ratio=np.ones(len(LEVELS) + 2),
        likely_worse=further,
    )
    source = BandSource(
        name="landmarks", spread="2 mm", reference="a film", sd={"bsr_deg": {"T8": 1.4}, "hump_mm": {"T8": 0.7}}
    )
    bands = Bands(sources=(source,), nonlinear=(), skin_mean_mm=2.0, skin_max_mm=2.0, draws=32)
    intervals = FoundBands(tuple(rows), bands, np.full(len(case.skin.vertices), 2.0), effects, likely)
    write_known_result(folder, mirrored=sign < 0.0, intervals=intervals)
    with drawn_figures() as figures:
        assert main(["report", str(folder)]) == 0
    return Shown(folder, sign, Page((folder / "report.html").read_text(encoding="utf-8")), figures)


def test_intervals_stand_at_their_level_on_the_console_in_the_page_and_in_the_plot(sure: Shown) -> None:
    (axes,) = sure.figures["rotation"].axes
    whiskers = {line.get_ydata()[0]: sorted(line.get_xdata()) for line in axes.lines if line.get_marker() == "|"}
    console = {line.split()[0]: line for line in plain(read_result(sure.folder)).splitlines() if line}
    assert console["level"].endswith("19 of 20")
    for number, (level, angle) in enumerate(AFTER.rotations.items()):
        ends = sorted(sure.sign * angle + way * 1.96 * SD for way in (-1.0, 1.0))
        assert whiskers[number] == pytest.approx(ends, abs=0.05)
        low, high = ends
        shown = " to ".join(f"{abs(end):.0f}" for end in sorted(ends, key=abs))
        if round(low) * round(high) < 0:
            shown = f"{abs(low):.0f} left to {high:.0f} right"
        assert " ".join(console[level].split()).endswith(f" {shown}")
        assert shown in sure.page.rows[level]


def test_likely_backs_stand_beside_the_prediction_better_first(sure: Shown) -> None:
    """The hump of the worse one is larger, on the side on which it is."""
    panels = sure.figures["likely"].axes[:3]
    middles = [[text for text in axes.texts if "T8:" in text.get_text()] for axes in panels]
    sizes = [float(texts[0].get_text().split()[1]) for texts in middles]
    assert sizes == sorted(sizes)
    assert sizes[1] == pytest.approx(AFTER.humps["T8"], abs=0.6)
    assert sizes[2] - sizes[0] > 2.0
    for axes, (text,) in zip(panels, middles, strict=True):
        assert side_at(axes, place(axes, *text.get_position())[0]) == sure.words("right")


def test_panels_have_their_headings_and_the_colours_a_scale(patient: Shown) -> None:
    headings = dict.fromkeys(("back", "hump", "front", "shoulders"), "Predicted") | {"spine_behind": "Planned"}
    for name, heading in headings.items():
        axes = patient.figures[name].axes[:2]
        assert [panel.get_title() for panel in axes] == ["Before surgery", heading], name
    bar = patient.figures["hump"].axes[-1]
    ticks = bar.get_xticks()
    limit = max(bar.get_xlim())
    assert np.diff(ticks) == pytest.approx([10.0 if limit <= 40.0 else 20.0] * (len(ticks) - 1))
    assert max(ticks) <= limit + 0.5
    assert ("further forward" in bar.texts[0].get_text(), "further back" in bar.texts[1].get_text()) == (
        True,
        True,
    )
    assert bar.texts[0].get_position()[0] < bar.texts[1].get_position()[0]


def test_vtks_own_reader_finds_the_shape_and_its_displacement(patient: Shown, tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista")
    _, mesh, displacement = known_case(mirrored=patient.sign < 0.0)
    assert main(["export", str(patient.folder), "--out", str(tmp_path / "tissue.vtu")]) == 0
    grid: Any = pyvista.read(tmp_path / "tissue.vtu")
    np.testing.assert_allclose(grid.points, mesh.nodes, atol=1e-4)
    np.testing.assert_array_equal(grid.cells_dict[pyvista.CellType.TETRA], mesh.tets)
    (name,) = (name for name in grid.point_data if grid.point_data[name].ndim == 2)
    on_bone = mesh.prescribed
    np.testing.assert_allclose(grid.point_data[name][on_bone], displacement[on_bone], atol=1e-4)
    tets = grid.extract_cells(grid.celltypes == pyvista.CellType.TETRA)
    assert tets.compute_cell_sizes(length=False, area=False)["Volume"].min() > 0.0


def test_every_picture_lies_within_its_frame_and_its_words_within_the_picture(patient: Shown) -> None:
    """Panels that are placed by hand; words by the axes of their panel, with room beside them."""
    for name, figure in patient.figures.items():
        for axes in figure.axes:
            box = axes.get_position()
            assert -1e-6 <= min(box.x0, box.y0) < max(box.x1, box.y1) <= 1.0 + 1e-6, name
            for text in axes.texts:
                if text.get_transform() == axes.transData and text.get_text():
                    across, up = place(axes, *text.get_position())
                    assert -0.1 <= across <= 1.1, (name, text.get_text())
                    assert -0.1 <= up <= 1.1, (name, text.get_text())


def test_sections_have_a_scale_and_the_plot_of_rotations_begins_at_the_top(patient: Shown) -> None:
    first, *later = (axes for axes in patient.figures["sections"].axes if axes.get_title(loc="left"))
    (bar,) = (line for line in first.lines if len(line.get_xdata()) == 2 and np.ptp(line.get_xdata()) == 100.0)
    assert np.ptp(bar.get_ydata()) == 0.0
    (words,) = (text for text in first.texts if text.get_text() == "100 mm")
    assert words.get_position()[0] == pytest.approx(np.mean(bar.get_xdata()))
    assert not any(text.get_text() == "100 mm" for axes in later for text in axes.texts)
    (axes,) = patient.figures["rotation"].axes
    rows = [place(axes, 0.0, row)[1] for row in range(len(LEVELS))]
    assert rows == sorted(rows, reverse=True)
    assert 0.0 < rows[-1] < rows[0] < 1.0


def test_lines_of_the_hump_are_solid_where_it_is_further_back(patient: Shown) -> None:
    """At 10 mm each; none is drawn at more than the back has."""
    for axes, shape in zip(patient.figures["hump"].axes[:2], STATES.values(), strict=True):
        solid, dashed = (lines for lines in axes.collections if hasattr(lines, "levels"))
        np.testing.assert_allclose(solid.levels, np.arange(10.0, 50.0, 10.0))
        np.testing.assert_allclose(dashed.levels, -solid.levels[::-1])
        highest = max(map(abs, shape.humps.values()))
        for lines, sign in ((solid, 1.0), (dashed, -1.0)):
            by_level = dict(zip(np.abs(lines.levels), lines.get_paths(), strict=True))
            assert len(by_level[10.0].vertices)
            assert not any(len(path.vertices) for level, path in by_level.items() if level > highest + 1.0)
            x, z = by_level[10.0].vertices.T
            at_t8 = np.abs(z - BEFORE.landmarks.of_bone("T8").points[:, 2].mean()) < 30.0
            if shape is BEFORE:
                assert side_at(axes, place(axes, float(x[at_t8].mean()), 0.0)[0]) == patient.side(sign)


def test_lines_of_depth_lie_on_the_back_that_faces_behind(patient: Shown) -> None:
    for axes in patient.figures["back"].axes[:2]:
        lengths = [len(path.vertices) for lines in axes.collections for path in lines.get_paths()]
        assert sum(lengths) > 500


def test_a_report_with_intervals_is_as_accepted(sure: Shown) -> None:
    if sure.sign > 0.0:  # other tests show that the mirror image differs by its sides alone
        check_shown("report_with_intervals", report_lines(sure.page, sure.figures))
        check_shown("result", plain(read_result(sure.folder)).replace(str(sure.folder), "FOLDER").splitlines())


def test_sources_of_error_stand_with_their_numbers(sure: Shown) -> None:
    assert sure.page.rows["landmarks"] == ["2 mm", "1.4", "0.7", "a film"]


def test_a_rotation_that_its_interval_hides_is_not_written_beside_its_section(sure: Shown) -> None:
    """Half of an interval is 2.9 degrees: more than the change and the size of T1's 1.1, less than T8's 7.3."""
    words = {
        axes.get_title(loc="left"): axes.get_title(loc="right").split(" → ")
        for axes in sure.figures["sections"].axes
        if axes.get_title(loc="left")
    }
    assert words["T8"] == [sure.sided(shape.rotations["T8"]) for shape in STATES.values()]
    assert words["T1"] == [sure.sided(BEFORE.rotations["T1"]), "not known"]
    assert words["T1"][1] in sure.page.rows["T1"][1]


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """Her result with the skin as it was scanned after surgery."""
    folder = write_known_result(tmp_path_factory.mktemp("judged"), actual=ACTUAL)
    with drawn_figures() as figures:
        assert main(["report", str(folder)]) == 0
    return Shown(folder, 1.0, Page((folder / "report.html").read_text(encoding="utf-8")), figures)


def test_a_report_beside_the_actual_back_is_as_accepted(judged: Shown) -> None:
    check_shown("report", report_lines(judged.page, judged.figures))


def test_the_actual_back_stands_beside_the_prediction_with_its_error(judged: Shown) -> None:
    heads = judged.page.rows["level"]
    assert heads[:5] == ["before surgery", "predicted", "change", "actual, after surgery", "error"]
    for level in LEVELS:
        was, will, really = (shape.rotations[level] for shape in (BEFORE, AFTER, ACTUAL))
        cells = judged.page.rows[level]
        assert [*cells[:2], cells[3]] == [judged.sided(value) for value in (was, will, really)]
        assert float(cells[4]) == pytest.approx(abs(will - really), abs=0.06)
    for part, levels in (("T3-T12", LEVELS[2:12]), ("L1-L5", LEVELS[12:])):
        (mean,) = judged.page.rows[f"Rotation of the back, mean absolute error {part} [°]"]
        errors_of_part = [abs(AFTER.rotations[level] - ACTUAL.rotations[level]) for level in levels]
        assert float(mean.split(" ± ")[0]) == pytest.approx(np.mean(errors_of_part), abs=0.03)
    panels = [axes for axes in judged.figures["sections"].axes if axes.get_title(loc="left")]
    for axes in panels:
        level = axes.get_title(loc="left")
        assert axes.get_title(loc="right").endswith(f"({judged.sided(ACTUAL.rotations[level])})")
    titles = [axes.get_title() for axes in judged.figures["hump"].axes[:3]]
    assert titles == ["Before surgery", "Predicted", "Actual, after surgery"]
    (axes,) = judged.figures["rotation"].axes
    lines = {str(line.get_label()): line.get_xdata() for line in axes.lines}
    np.testing.assert_allclose(lines["actual, after surgery"], [*ACTUAL.rotations.values()], atol=0.05)
    summary = json.loads((judged.folder / "summary.json").read_text(encoding="utf-8"))
    by_state = {
        (row["state"], row["level"]): row["value"] for row in summary["measures"] if row["quantity"] == "bsr_deg"
    }
    assert by_state["actual", "L3"] == pytest.approx(-12.2, abs=0.05)
    of_actual = {row["quantity"] for row in summary["measures"] if row["state"] == "actual"}
    assert "main_hump_mm" in of_actual
    assert not {"cobb_deg", "axial_rotation_deg"} & of_actual  # her spine was not measured again


def test_a_second_skin_is_compared_with_its_warnings(
    judged: Shown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(measure_command, "arm_warnings", lambda *_: ["It has an arm."])
    case = known_case(actual=ACTUAL)[0]
    write_surface(tmp_path / "actual.ply", not_none(case.actual_skin))
    assert (
        main(["measure", str(judged.folder), "--against", str(tmp_path / "actual.ply"), "--out", str(tmp_path)])
        == 0
    )
    said = capsys.readouterr()
    assert "warp-trunk: warning: It has an arm." in said.err.splitlines()
    assert "Error of the back surface rotation, predicted against actual" in said.out


def test_layers_are_where_they_were_put_with_their_own_constants(tmp_path: Path) -> None:
    """Fat on her left above the loin, skin on top, muscle elsewhere: by VTK's reader and in Abaqus' format."""
    pyvista = pytest.importorskip("pyvista")
    case, mesh, _ = known_case()
    centres = mesh.nodes[mesh.tets].mean(axis=1)
    fat = (centres[:, 0] > 20.0) & (centres[:, 2] > 100.0)
    labels = np.where(centres[:, 2] > 430.0, 0, np.where(fat, 1, 2)).astype(np.int8)
    layered = replace(case, layers=Layers(constants={"fat": {"youngs_modulus": 3.5}}))
    write_known_result(tmp_path / "result", layered=(layered, replace(mesh, tissue=labels)))
    summary = json.loads((tmp_path / "result" / "summary.json").read_text(encoding="utf-8"))
    assert [tissue["youngs_modulus"] for tissue in summary["tissues"]] == [130.0, 3.5, 10.0]
    for name in ("tissue.vtu", "tissue.inp"):
        assert main(["export", str(tmp_path / "result"), "--out", str(tmp_path / name)]) == 0
    grid: Any = pyvista.read(tmp_path / "tissue.vtu")
    tets = grid.extract_cells(grid.celltypes == pyvista.CellType.TETRA)
    middles = tets.cell_centers().points
    np.testing.assert_allclose(middles, centres, atol=1e-4)
    np.testing.assert_array_equal(tets.cell_data["tissue"], labels)
    deck = (tmp_path / "tissue.inp").read_text(encoding="utf-8").upper()
    moduli = re.findall(r"\*MATERIAL, NAME=.*\n\*ELASTIC\n([^,]+),", deck)
    assert sorted(map(float, moduli)) == pytest.approx([0.0035, 0.01, 0.13])  # MPa


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
    of_levels = errors([row]).filter(guess="predicted").select("level", "error").rows()
    for level, error in of_levels:
        assert error == pytest.approx(AFTER.rotations[level] - ACTUAL.rotations[level], abs=0.06)
    assert {level for level, _ in of_levels} == set(LEVELS)
