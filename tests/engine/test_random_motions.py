"""Small blocks, anyhow jittered, turned, shifted and started: what is claimed of their ending is true."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from support.draws import Draws, fresh_seeds
from support.hard_cases import Case, end, true_error
from support.meshes import block, rotate
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue


@dataclass(frozen=True, kw_only=True)
class Motion:
    """A block and where its held face goes."""

    cells: tuple[int, int, int]
    jitter: float
    """Share of an edge by which nodes are off the grid."""
    turn: float
    """Of the held face about the axis [degrees]."""
    axis: tuple[float, float, float]
    shift: tuple[float, float, float]
    """Of the held face [mm]."""
    noise: float
    """Of where the free nodes start [mm]."""
    theta: float
    gravity: float
    """[m/s^2]"""
    precision: str


def drawn(seed: int) -> Motion:
    """The motion of a seed."""
    draws = Draws(seed)
    return Motion(
        cells=(draws.whole(1, 2), draws.whole(1, 2), draws.whole(1, 3)),
        jitter=draws.number(0.0, 0.2),
        turn=draws.number(-180.0, 180.0),
        axis=(draws.number(-1.0, 1.0), draws.number(-1.0, 1.0), draws.number(0.1, 1.0)),
        shift=(draws.number(-30.0, 30.0), draws.number(-30.0, 30.0), draws.number(-30.0, 30.0)),
        noise=draws.number(0.0, 6.0),
        theta=draws.one_of((0.0, 1.0, 10.0, 1000.0)),
        gravity=draws.one_of((0.0, 9.81)),
        precision=draws.one_of(("float32", "float64")),
    )


ROUNDING_IS_LEFT = Motion(
    cells=(2, 2, 2),
    jitter=0.1400503799722528,
    turn=0.0,
    axis=(-0.0017919600214437725, -0.35082665816423375, 0.7941607719015576),
    shift=(21.702966378153917, -3.8584626479235666, 0.0),
    noise=5.451708884559633,
    theta=1000.0,
    gravity=9.81,
    precision="float32",
)
STIFF_AND_TURNED_BY_100_DEGREES = Motion(
    cells=(2, 2, 3),
    jitter=0.035040195324088516,
    turn=100.66664620302748,
    axis=(0.011054150710757549, 0.5415933947188338, 0.6950399929932437),
    shift=(13.00318536053016, 6.965642410818148, -20.214036663682634),
    noise=0.15,
    theta=1000.0,
    gravity=0.0,
    precision="float64",
)


def check(motion: Motion, threads: int = 2) -> None:
    """Held where it was put, downhill at every step, nothing inverted, and CONVERGED only where that is true."""
    mesh = block(motion.cells, jitter=motion.jitter)
    start = motion.noise * np.random.default_rng(1).normal(size=mesh.nodes.shape)
    moved = rotate(mesh.nodes, motion.turn, motion.axis) + motion.shift - mesh.nodes
    start[mesh.prescribed] = moved[mesh.prescribed]
    start = start.astype(motion.precision).astype(float)
    case = Case(
        mesh,
        start,
        tissue=Tissue(theta=motion.theta),
        gravity=motion.gravity,
        precision=motion.precision,
        threads=threads,
    )
    ending = end(case)
    relaxation = ending.relaxation
    assert relaxation.status in {RelaxStatus.CONVERGED, RelaxStatus.STALLED, RelaxStatus.STEP_LIMIT}
    assert np.isfinite(ending.displacement).all()
    assert (ending.displacement[mesh.prescribed] == start[mesh.prescribed]).all()
    energies = [step.energy.total for step in relaxation.history]
    slack = 1e-12 if motion.precision == "float64" else 1e-6
    assert (np.diff(energies) <= slack * np.abs(energies).max(initial=0.0)).all()
    if motion.precision == "float64":
        assert ending.new_inversions == 0
    if relaxation.status is RelaxStatus.CONVERGED:
        assert relaxation.estimated_error <= case.tolerance
        rounding = 1e-6 * np.abs(ending.displacement).max() if motion.precision == "float32" else 0.0
        assert true_error(case, ending) <= 2.0 * relaxation.estimated_error + rounding


def test_where_rounding_is_what_is_left() -> None:
    check(ROUNDING_IS_LEFT)


@pytest.mark.slow
@pytest.mark.parametrize("threads", [1, 2, 5])
def test_a_stiff_block_turned_by_100_degrees(threads: int) -> None:
    """The way is long and rounding decides it: 0.0076 mm was once reported where 0.0195 was true."""
    check(STIFF_AND_TURNED_BY_100_DEGREES, threads)


@pytest.mark.parametrize("seed", range(20))
def test_random_meshes_and_motions(seed: int) -> None:
    check(drawn(seed))


@pytest.mark.search
def test_search_for_motions_whose_ending_is_not_true() -> None:
    for seed in fresh_seeds():
        try:
            check(drawn(seed))
        except AssertionError as error:
            error.add_note(f"seed {seed}: {drawn(seed)}")
            raise
