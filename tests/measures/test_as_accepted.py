"""Every number of known bodies, with its place, its words and what is missing, compared with accepted texts."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from support.asserting import not_none
from support.known_patient import ACTUAL, AFTER, BEFORE, Shape, known_case
from support.phantoms import whole_phantom
from support.shown import check_shown, described
from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import TrunkMeasures, compare_skins, measure, measure_back
from warp_trunk.measures.comparison import SkinComparison, comparison_rows
from warp_trunk.measures.measures import measure_spine
from warp_trunk.measures.number_text import value_text
from warp_trunk.measures.quantities import QUANTITIES, Measured, MeasureTable, measured
from warp_trunk.measures.rows import (
    MeasureRow,
    as_markdown,
    comparison_text,
    measure_rows,
    measures_text,
    rotation_table,
    under_headings,
)
from warp_trunk.measures.skin_quality import skin_quality

LIKE = {"hump_mm": 0.2, "shoulder_difference_mm": 0.2, "waist_height_mm": 0.2}
"""How near a number of the known patient is to that of her construction, other ones within 0.02."""


@pytest.fixture(scope="module")
def patient() -> tuple[Case, dict[str, TrunkMeasures]]:
    """The known patient before, predicted and after surgery."""
    case, mesh, displacement = known_case(AFTER, actual=ACTUAL)
    predicted = case.skin.moved((mesh.nodes + displacement)[mesh.skin_nodes])
    before, after = case.landmarks_before, not_none(case.landmarks_after)
    states = {
        "before": measure(case.skin, before),
        "predicted": measure(predicted, after, case.skin),
        "actual": measure(not_none(case.actual_skin), after),
    }
    return replace(case, skin=predicted), states


def numbers(table: MeasureTable) -> Iterator[str]:
    """Every number of a table by quantity and level, of each state, and as text after the last one."""
    states = list(dict.fromkeys(row.state for row in table.rows))
    for key, level in dict.fromkeys((row.quantity, row.level) for row in table.rows):
        quantity, values = QUANTITIES[key], [table.value(state, key, level) for state in states]
        text = value_text(quantity, values[-1], f" {quantity.unit}")
        yield " | ".join([quantity.label_at(level), *map(described, values), text])


def errors(comparison: SkinComparison) -> Iterator[str]:
    """Every number of a comparison, one line for each level, range or region."""
    rows = comparison_rows(comparison)
    for level in dict.fromkeys(row.level for row in rows):
        own = (f"{row.quantity} {described(row.value)}" for row in rows if row.level == level)
        yield " | ".join([level, *own])


def built(shape: Shape) -> dict[str, dict[str, float]]:
    """Numbers that the known patient has by construction, by quantity and level."""
    tilts, (left, low), (right, high) = shape.at_levels(shape.tilts), shape.waist["left"], shape.waist["right"]
    curves = {f"{a}-{b}": abs(tilts[a] - tilts[b]) for a, b in pairwise(("T1", "T4", "T11", "L4"))}
    return {
        "bsr_deg": shape.rotations,
        "hump_mm": shape.humps,
        "axial_rotation_deg": shape.at_levels(shape.turned),
        "tilt_deg": {level: -tilt for level, tilt in tilts.items()},
        "cobb_deg": curves,
        "kyphosis_deg": {"T1-T12": 38.0},
        "waist_depth_left_mm": {"": left},
        "waist_depth_right_mm": {"": right},
        "waist_height_mm": {"": high - low},
        "shoulder_difference_mm": {"": shape.shoulder_difference},
    }


def test_every_number_of_the_known_patient_is_as_accepted(patient: tuple[Case, dict[str, TrunkMeasures]]) -> None:
    """Angles of back and spine, humps, waist and shoulders are first compared with her construction."""
    (case, states), shapes = patient, (BEFORE, AFTER, ACTUAL)
    before = states["before"]
    table = MeasureTable.of(states)
    for state, shape in zip(states, shapes, strict=True):
        for key, levels in built(shape).items():
            values = {level: table.value(state, key, level) for level in levels}
            assert values == pytest.approx(levels, abs=LIKE.get(key, 0.02)), (state, key)
    comparison = compare_skins(case.skin, not_none(case.actual_skin), not_none(case.landmarks_after))
    sure = [
        Measured.with_sd(
            "predicted", row.level, row.quantity, row.value, 0.1 * (1 + len(row.level) + abs(row.value))
        )
        for row in table.rows
        if row.state == "predicted" and row.value is not None
    ]
    banded = table.with_intervals(sure)
    of_spine = [row.quantity for row in measured("before", before, of="spine")]
    rows = under_headings(measure_rows(banded, before, [*states]), MeasureRow.compared_cells)
    rotations = rotation_table(banded, [*states], MeasureRow.compared_cells, bands=True)
    check_shown(
        "numbers",
        [
            *map(repr, states.values()),
            measures_text(states["predicted"], before),
            as_markdown(["", "before", "predicted", "change", "actual", "off"], rows),
            as_markdown(["", "before", "predicted", "change", "actual", "off", "19 of 20"], rotations),
            comparison_text(comparison),
            *numbers(table),
            f"of a spine alone: {', '.join(dict.fromkeys(of_spine))}",
            *errors(comparison),
        ],
    )


def test_what_is_missing_and_why_is_as_accepted() -> None:
    """Of a phantom of which a part was not scanned, or that ends below T1, or of whose spine little is known."""
    case = whole_phantom()
    marks, points = case.landmarks_before, case.skin.vertices
    whole = measure(case.skin, marks)
    z = not_none(whole.tangents["T8"]).height
    unseen = {
        "the front": points[:, 1] < 0.0,
        "the right half": points[:, 0] < 0.0,
        "20 mm at T8": np.abs(points[:, 2] - z) < 10.0,
        "nothing": np.zeros(len(points)),
    }
    low = np.column_stack([points[:, :2], np.minimum(points[:, 2], whole.spine.centroids[0, 2] - 8.0)])
    moved = case.skin.moved(points + 3.0 * (np.abs(points[:, 2:] - z) < 10.0))
    states = {name: measure(moved, marks, case.skin, unseen=away) for name, away in unseen.items()}
    states["what is above T1"] = measure(case.skin.moved(low), marks)
    lines = [f"== {name}: {line}" for name, measures in states.items() for line in absent(measures, whole)]
    lines.append(measures_text(states["what is above T1"], whole))
    few = [row for row, name in enumerate(marks.names) if name.startswith(("T3_", "T9_", "L2_", "asis"))]
    spine = measure(case.skin, Landmarks(tuple(marks.names[row] for row in few), marks.points[few]))
    lines += [f"== all but T3, T9 and L2: {line}" for line in absent(spine, spine)]
    check_shown("missing_numbers", lines)


def absent(measures: TrunkMeasures, reference: TrunkMeasures) -> Iterator[str]:
    """Why something is missing, and where each quantity is missing."""
    yield from (f"{what}: {why}" for what, why in measures.missing.items())
    rows = measured("", measures, reference)
    for key in dict.fromkeys(row.quantity for row in rows):
        at = [row.level for row in rows if row.quantity == key and row.value is None]
        if any(at):
            yield f"no {key} at {' '.join(at)}"
        elif at:
            yield f"no {key}"
    yield f"movement {measures.skin_change_max}, {measures.skin_change_mean}"


def test_a_curved_back_by_a_line_of_bodies_is_as_accepted() -> None:
    """Of the phantom, whose vertebrae are taken to turn with its curve."""
    case = whole_phantom()
    marks, bodies = case.landmarks_before, measure_spine(case.landmarks_before).spine.centroids
    spines = marks.points[[marks.index("asis_left"), marks.index("asis_right")]]
    markers = Landmarks(("C7", "ASIS_left", "ASIS_right"), np.vstack([bodies[0] + [0.0, 40.0, 12.0], spines]))
    back = measure_back(case.skin, bodies, markers)
    places = (f"{level} at {described(not_none(at).spinous)}" for level, at in back.levels.items())
    check_shown("line_of_bodies", [back.text(), *places])


def test_places_of_stretched_and_folded_skin_are_as_accepted() -> None:
    """At the left loin, behind the thorax on the right, in front of the neck, and below the right hip."""
    case, _, _ = known_case()
    points, lines = case.skin.vertices, list[str]()
    bones = {f"ball at {z}": Surface(0.01 * points + [0.0, 0.0, z], case.skin.faces) for z in (-100, 400)}
    for at in ((150.0, 0.0, 60.0), (-60.0, 100.0, 250.0), (0.0, -100.0, 440.0), (-150.0, 0.0, -100.0)):
        near = (np.linalg.norm(points - at, axis=1) < 70.0)[:, None]
        wave = 9.0 * np.cos(points[:, 2:] / 2.0) * [1.0, 1.0, 0.0]
        spoilt = case.skin.moved(points + near * (wave + 0.5 * (points - at) * [0.0, 0.0, 1.0]))
        quality = skin_quality(case.skin, spoilt, case.landmarks_before)
        by_bones = skin_quality(case.skin, spoilt, None, bones)
        lines += [repr(quality), *quality.faults, by_bones.folded_at, by_bones.stretched_at]
    check_shown("skin_faults", lines)
