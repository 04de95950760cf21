"""The papers' model by its symbols: constants and energies of a run against an independent evaluation."""

import math
from dataclasses import replace

import numpy as np
import pytest

from support.reference import Reference
from support.small_trunk import small_case
from warp_trunk.engine.tissue import EARTH_GRAVITY, Tissue
from warp_trunk.engine.trunk_mesh import tet_volumes
from warp_trunk.results.summary_text import plain
from warp_trunk.run.options import RunOptions
from warp_trunk.run.patient import patient_of
from warp_trunk.run.simulate import simulate

CASE, TRUNK = small_case()
EPSILON, THETA, ALPHA = 2.0, 5.0, 0.003


@pytest.fixture(scope="module")
def result():
    case = replace(CASE, tissue=Tissue(epsilon=EPSILON, theta=THETA))
    options = RunOptions.of_papers(alpha=ALPHA, device="cpu", threads=1, precision="float64", record=False)
    return simulate(case, patient=patient_of(case, options, TRUNK), warnings=())


def test_a_run_reports_the_constants_and_energies_of_eq_4_6(result) -> None:
    springs, (trunk, displacement) = result.summary.springs, result.tissue
    volume = tet_volumes(trunk.nodes, trunk.tets) * 1e-9
    mass, height = 1000.0 * volume.mean(), np.ptp(trunk.nodes[:, 2]) * 1e-3
    k_d = 2.0 * EARTH_GRAVITY * mass * height / ALPHA
    assert (springs.epsilon, springs.theta) == (EPSILON, THETA)
    wanted = {"alpha": ALPHA, "mean_mass_kg": mass, "height_m": height, "k_d_joule": k_d}
    assert {name: getattr(springs, name) for name in wanted} == pytest.approx(wanted, rel=1e-9)
    tissue = Tissue(
        epsilon=EPSILON,
        theta=THETA,
        youngs_modulus=k_d * len(Reference(trunk).edges) / (5e3 * volume.sum()),
    )
    terms = Reference(trunk, tissue, EARTH_GRAVITY).energies(displacement)
    bare = {"distance": terms["distance"], "area": terms["area"] / EPSILON, "volume": terms["volume"] / THETA}
    bare |= {"gravity": terms["gravity"] / ALPHA, "total": math.fsum(terms.values())}
    assert {name: getattr(springs, name) for name in bare} == pytest.approx(bare, rel=1e-7)
    parts = springs.distance + EPSILON * springs.area + THETA * springs.volume + ALPHA * springs.gravity
    assert springs.total == pytest.approx(parts, rel=1e-9)


def test_the_same_numbers_are_printed_and_kept(result, tmp_path) -> None:
    result.save(tmp_path / "papers")
    said = plain(result)
    assert f"epsilon {EPSILON:g}, theta {THETA:g}, alpha {ALPHA:.4g}; k_D" in said
    assert result.summary.parameters["alpha"] == ALPHA
    assert result.summary.parameters["gravity"] == EARTH_GRAVITY


def test_alpha_is_gravity_against_stiffness(result) -> None:
    """The same equilibrium from gravity and the Young's modulus that make this alpha."""
    case = replace(CASE, tissue=replace(result.summary.tissues[0]))
    options = RunOptions.of_papers(
        gravity=EARTH_GRAVITY, device="cpu", threads=1, precision="float64", record=False
    )
    other = simulate(case, patient=patient_of(case, options, TRUNK), warnings=())
    np.testing.assert_allclose(other.skin.vertices, result.skin.vertices, rtol=0.0, atol=1e-9)
