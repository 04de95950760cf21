"""Search for claims of CONVERGED that are false, among random small trunks.

Usage: python scripts/search_false_claims.py [CASES] [--seed FIRST] [--energy E] [--processes N] [--json FILE]

Each seed draws a small block of Delaunay tetrahedra with one bone or two, turned by up to 60 degrees and shifted
by up to 15 mm; a start with noise, or increments that lead there; the constants, the tolerance and the precision.
A claim is false where the true distance to the equilibrium is more than twice the reported one, rounding allowed
(1e-6 of the largest displacement), or where the equilibrium is a saddle. The truth is the NumPy reference of the
tests (tests/support): energies written apart, downhill by SciPy, then Newton on a dense second derivative. Every
claim is judged, those of increments on the way too. Ends with status 1 if one was false.
"""

import json
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
import warp as wp
from processes import in_processes
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from warp_trunk import InputError, Tissue
from warp_trunk.bone_motion.prescribed_motion import PrescribedMotion
from warp_trunk.engine.build import build_model
from warp_trunk.engine.newton import Relaxer
from warp_trunk.engine.parallel import Parallel
from warp_trunk.engine.physics import Physics
from warp_trunk.engine.relaxation import Relaxation, RelaxOptions, RelaxStatus
from warp_trunk.engine.simulation import SimulationOptions, simulate
from warp_trunk.engine.trunk_mesh import TrunkMesh, oriented, tet_volumes
from warp_trunk.measures.rows import as_markdown

sys.path.append(str(Path(__file__).parents[1] / "tests"))

from support.continuum import Continuum
from support.reference import Reference

ENERGIES = ("itmsm", "neo-hookean")
MOST_STEPS = 200


@dataclass(frozen=True)
class Draw:
    """The trunk of a seed."""

    seed: int
    energy: Any
    precision: str
    tolerance: float
    increments: int
    """0: one relaxation from a start with noise."""
    noise: float
    """Standard deviation of the start [mm]."""
    turn: float
    """Of each bone [degrees]."""
    bones: int
    gravity: float
    tissue: Tissue


@dataclass(frozen=True)
class Claim:
    """How a relaxation of a case ended, and the truth where it claims to have converged."""

    seed: int
    increment: int
    status: str
    reported: float
    true: float | None
    false: bool


def draw(seed: int, energy: str | None) -> tuple[Draw, TrunkMesh, np.ndarray]:
    """The case of a seed: what was drawn, the trunk, and where its nodes start or its bones end [mm]."""
    rng = np.random.default_rng(seed)
    trunk = random_block(rng)
    choice = energy or ENERGIES[seed % 2]
    led = bool(rng.random() < 0.5)
    drawn = Draw(
        seed=seed,
        energy=choice,
        precision=str(rng.choice(["float32", "float64"])),
        tolerance=float(rng.choice([0.1, 0.01, 0.001])),
        increments=int(rng.integers(2, 7)) if led else 0,
        noise=0.0 if led else float(rng.choice([0.0, 0.3, 1.0, 3.0, 6.0])),
        turn=float(rng.uniform(0.0, 60.0)),
        bones=int(trunk.bone.max()) + 1,
        gravity=float(rng.choice([0.0, 0.0, 9.81])),
        tissue=Tissue(
            epsilon=float(10.0 ** rng.uniform(-2.0, 1.0)),
            theta=float(rng.choice([0.0, 1.0, 10.0, 100.0, 1000.0])),
            poisson_ratio=float(rng.choice([0.0, 0.3, 0.45, 0.49, 0.499])),
        ),
    )
    moved = drawn.noise * rng.normal(size=trunk.nodes.shape)
    for bone in range(drawn.bones):
        nodes = trunk.bone == bone
        turn = Rotation.from_rotvec(np.radians(drawn.turn) * unit(rng.normal(size=3)))
        centre = trunk.nodes[nodes].mean(axis=0)
        shift = rng.uniform(0.0, 15.0) * unit(rng.normal(size=3))
        moved[nodes] = turn.apply(trunk.nodes[nodes] - centre) + centre + shift - trunk.nodes[nodes]
    return drawn, trunk, moved


def unit(v: np.ndarray) -> np.ndarray:
    """The vector at length 1."""
    return v / np.linalg.norm(v)


def random_block(rng: np.random.Generator) -> TrunkMesh:
    """Delaunay tetrahedra of a jittered grid, slivers left out, with one bone below or another above as well."""
    while True:
        cells, edge = rng.integers(2, 5, size=3), rng.uniform(5.0, 20.0)
        grid = np.stack(np.meshgrid(*[np.arange(n) for n in cells], indexing="ij"), axis=-1).reshape(-1, 3)
        nodes = edge * (grid + rng.uniform(0.05, 0.35) * rng.uniform(-1.0, 1.0, size=grid.shape))
        tets = Delaunay(nodes).simplices.astype(np.int32)
        volume = tet_volumes(nodes, tets)
        tets = oriented(nodes, tets[np.abs(volume) > 0.01 * edge**3])
        used = np.unique(tets)
        bone = np.full(len(nodes), -1, dtype=np.int32)
        bone[grid[:, 2] == 0] = 0
        if cells[2] > 2 and rng.random() < 0.5:
            bone[grid[:, 2] == cells[2] - 1] = 1
        trunk = TrunkMesh(
            nodes=nodes[used],
            tets=np.searchsorted(used, tets).astype(np.int32),
            skin_nodes=np.empty(0, dtype=np.int32),
            skin_faces=np.empty((0, 3), dtype=np.int32),
            bone=bone[used],
            bone_names=("lower", "upper")[: int(bone[used].max(initial=-1)) + 1],
            bone_faces=np.empty((0, 3), dtype=np.int32),
        )
        if not (trunk.bone < 0).any():
            continue
        try:
            build_model(trunk, physics=Physics(energy="itmsm", skin_rigidity=0.0), device=Parallel("cpu", 1))
        except InputError:  # a part that no bone holds
            continue
        return trunk


def endings(drawn: Draw, trunk: TrunkMesh, moved: np.ndarray) -> Iterator[tuple[Relaxation, np.ndarray]]:
    """Each relaxation of the case and where it ended [mm]."""
    model = build_model(
        trunk,
        drawn.tissue,
        Physics(energy=drawn.energy, gravity=drawn.gravity, skin_rigidity=0.0),
        device=Parallel("cpu", 1),
        precision=drawn.precision,
    )
    options = RelaxOptions(tolerance=drawn.tolerance, max_steps=MOST_STEPS)
    if drawn.increments:
        steps = SimulationOptions(increments=drawn.increments, relax=options)
        for increment in simulate(model, PrescribedMotion(moved), steps):
            yield increment.relaxation, increment.displacement
        return
    relaxer = Relaxer(model, options)
    relaxer.state.set_displacement(moved)
    yield relaxer.relax(), relaxer.state.host_displacement()


def judge(seed: int, energy: str | None) -> tuple[Draw, list[Claim]]:
    """Runs a case and measures every claim it makes."""
    wp.config.log_level = wp.LOG_WARNING
    drawn, trunk, moved = draw(seed, energy)
    reference = (Reference if drawn.energy == "itmsm" else Continuum)(trunk, drawn.tissue, drawn.gravity)
    claims = []
    for number, (relaxation, displacement) in enumerate(endings(drawn, trunk, moved), start=1):
        reported, true, false = relaxation.estimated_error, None, False
        if relaxation.status is RelaxStatus.CONVERGED:
            true = true_distance(reference, displacement, 1e-4 * drawn.tolerance)
            false = not true <= 2.0 * reported + 1e-6 * np.abs(displacement).max()
        claims.append(Claim(seed, number, relaxation.status.name, reported, true, false))
    return drawn, claims


def true_distance(reference: Reference, displacement: np.ndarray, tolerance: float) -> float:
    """Largest distance of a node from the minimum downhill [mm]; infinite where what is found is a saddle."""
    equilibrium = by_newton(reference, displacement, tolerance)
    if equilibrium is None:
        equilibrium = reference.equilibrium(displacement, tolerance)
        curvature = np.linalg.eigvalsh(reference.hessian(equilibrium))
        if curvature[0] < -1e-9 * curvature[-1]:
            return float("inf")
    return float(np.linalg.norm(equilibrium - displacement, axis=1).max())


def by_newton(reference: Reference, displacement: np.ndarray, tolerance: float) -> np.ndarray | None:
    """The minimum near a displacement, by simplified Newton steps that each halve the last, or None.

    Where the curvature is positive and the steps shrink at least so fast, there is one equilibrium within twice
    the first step, a minimum (Newton-Kantorovich).
    """
    try:
        factor = cho_factor(reference.hessian(displacement))
    except np.linalg.LinAlgError:
        return None
    at, last = displacement.copy(), np.inf
    while True:
        step = -cho_solve(factor, reference.gradient(at)[reference.free].ravel()).reshape(-1, 3)
        longest = float(np.linalg.norm(step, axis=1).max())
        at[reference.free] += step
        if longest < tolerance:
            return at
        if not longest <= 0.5 * last:
            return None
        last = longest


def table(results: list[tuple[Draw, list[Claim]]]) -> str:
    """Table of endings and false claims by energy and precision, in Markdown."""
    head = ["energy", "precision", "cases", "CONVERGED at the end", "claims judged", "false"]
    rows = []
    for energy in ENERGIES:
        for precision in ("float32", "float64"):
            mine = [c for d, c in results if (d.energy, d.precision) == (energy, precision)]
            if not mine:
                continue
            last = sum(claims[-1].status == "CONVERGED" for claims in mine)
            judged = [c for claims in mine for c in claims if c.true is not None]
            ratio = max((c.true / c.reported for c in judged if c.true is not None), default=0.0)
            wrong = sum(c.false for c in judged)
            at_end = f"{last} ({100.0 * last / len(mine):.1f} %)"
            counts = (str(len(judged)), str(wrong), f"{ratio:.2f}")
            rows.append([energy, precision, str(len(mine)), at_end, *counts])
    return as_markdown([*head, "true / reported, largest"], rows)


@dataclass(frozen=True, kw_only=True)
class Options:
    """The cases that are drawn."""

    cases: tyro.conf.Positional[int] = 2000
    """How many."""
    seed: int = 0
    """The first seed."""
    energy: Literal["itmsm", "neo-hookean"] | None = None
    """One only; else they take turns."""
    processes: int = 1
    """How many cases are judged at once."""
    json: Path | None = None
    """Where to write every claim."""


def main(options: Options) -> int:
    """Draws the cases and prints what was found."""
    seeds = range(options.seed, options.seed + options.cases)
    results = []
    for done, result in enumerate(in_processes(judge, seeds, options.energy, options.processes), start=1):
        results.append(result)
        for claim in result[1]:
            if claim.false:
                print(f"FALSE {claim}\n      {result[0]}", flush=True)
        if done % 100 == 0:
            print(f"{done} of {len(seeds)}", file=sys.stderr, flush=True)
    if options.json:
        rows = [asdict(d) | {"claims": [asdict(c) for c in claims]} for d, claims in results]
        options.json.write_text(json.dumps(rows), encoding="utf-8", newline="\n")
    print(f"seeds {seeds[0]} to {seeds[-1]}")
    print(dict(Counter(claims[-1].status for _, claims in results)))
    print(table(results))
    return int(any(claim.false for _, claims in results for claim in claims))


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options, description=__doc__)))
