"""Result folders for the report's tests: the small trunk, turned by known angles."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from warp_trunk.engine.build import build_model
from warp_trunk.engine.model import Model
from warp_trunk.engine.parallel import Parallel
from warp_trunk.engine.physics import Physics
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.measures.measures import measure_level
from warp_trunk.measures.quantities import BETTER, EXACT, PREDICTED, WORSE, Measured
from warp_trunk.results import RunAccount, result_of
from warp_trunk.results.bands import Bands, BandSource, Effects, FoundBands

from .meshes import turned_about_z
from .small_trunk import made_up_increments, small_case


@cache
def result_model() -> Model:
    """Options of these results."""
    _, trunk = small_case()
    return build_model(
        trunk,
        physics=Physics(energy="itmsm", skin_rigidity=0.0),
        device=Parallel("cpu", 1),
        precision="float64",
    )


def write_small_result(
    folder: Path,
    *,
    name: str = "small",
    status: RelaxStatus = RelaxStatus.CONVERGED,
    turn_more: float | None = None,
    without: str | None = None,
    intervals: FoundBands | None = None,
) -> Path:
    """Write a result; the prediction is turned by 12 degrees at T4, evenly less towards 0 at the bottom.

    Args:
        folder: where to.
        name: of the case.
        status: how its last relaxation ended.
        turn_more: how many degrees the actual skin is turned further at every height; None for no actual skin.
        without: a level whose plane misses the trunk.
        intervals: how sure the numbers are.
    """
    case, trunk = small_case()
    increments = made_up_increments(trunk, status=status)
    if turn_more is not None:
        skin = (trunk.nodes + increments[-1].displacement)[trunk.skin_nodes]
        case = replace(case, actual_skin=case.skin.moved(turned_about_z(skin, -turn_more)))
    if without is not None:
        up = np.array([[0.0, 0.0, 500.0 * n.startswith(f"{without}_")] for n in case.landmarks_before.names])
        lifted = [
            replace(marks, points=marks.points + up) for marks in (case.landmarks_before, case.planned_landmarks)
        ]
        case = replace(case, landmarks_before=lifted[0], landmarks_after=lifted[1])
    result_of(
        replace(case, name=name),
        trunk,
        result_model(),
        increments,
        RunAccount(parameters={"tolerance": 0.01}, seconds={"total": 1.0}, intervals=intervals),
    ).save(folder)
    return folder


def small_bands(vertices: int) -> FoundBands:
    """Bands of the small result: a deviation of 1.5 degrees at every level, of 2 mm on all of the skin."""
    angles = {"T4": 12.0, "T8": 9.3, "T12": 6.7, "L3": 4.0}
    rows = [
        Measured.with_sd(state, level, "bsr_deg", angle, sd)
        for state, sd in ((PREDICTED, 1.5), (EXACT, 0.5))
        for level, angle in angles.items()
    ]
    rows += [Measured.with_sd(PREDICTED, "T4", key, 11.0, 2.0) for key in ("hump_mm", "main_hump_mm")]
    rows.append(Measured.with_sd(PREDICTED, "T5-T12", "kyphosis_deg", 30.0, 6.0))
    rows.append(Measured.with_sd(PREDICTED, "", "trunk_shift_mm", -2.0, 1.0))
    source = BandSource(
        name="landmarks",
        spread="2.1 +- 1.5 mm",
        reference="section <5.2> of [2]",
        sd={"bsr_deg": {"T4": 1.4}, "hump_mm": {"T4": 0.7}},
    )
    nonlinear = (("bsr_deg", "T4"),)
    bands = Bands(sources=(source,), nonlinear=nonlinear, skin_mean_mm=2.0, skin_max_mm=2.0, draws=32)
    names = np.array([(row.quantity, row.level) for row in rows if row.state == PREDICTED])
    case, trunk = small_case()
    skin = case.skin.vertices
    right_back = (skin[:, 0] < 0.0) & (skin[:, 1] > 0.0)
    worse = np.outer(right_back, [0.0, 2.56, 0.0])  # 80 % of the hump's deviation of 2 mm
    predicted = (trunk.nodes + made_up_increments(trunk)[-1].displacement)[trunk.skin_nodes]
    likely = {
        state: measure_level(case.skin.moved(predicted + sign * worse), case.planned_landmarks, "T4")
        for state, sign in ((BETTER, -1.0), (WORSE, 1.0))
    }
    effects = Effects(
        names=names,
        sources=np.array(["amount of correction"]),
        effects=np.full((len(names), 1), 1.0),
        landmarks=np.zeros((len(names), 6)),
        ratio=np.ones(len(names)),
        likely_worse=worse,
    )
    return FoundBands(tuple(rows), bands, np.full(vertices, 2.0), effects, likely)
