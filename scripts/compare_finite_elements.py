"""warp_trunk's neo-Hookean tissue against scikit-fem, an independent finite element package, on the same mesh.

    uv run --group fem python scripts/compare_finite_elements.py phantom --tets 86500 --solvers
    uv run --group fem python scripts/compare_finite_elements.py CASE --tets 130000

Prints how far the two ends are apart; --solvers also times one linear solve by every solver installed. `phantom`
stands for the built-in phantom. Without --group fem only SciPy's solvers are there, which are slow. How long both
take is measured by compare_peers.py.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from benchmarking.prepare import load_case, mesh_case
from benchmarking.problem import Problem
from benchmarking.process import be_quiet
from benchmarking.record import hardware
from finite_elements.compare import Comparison
from finite_elements.linear import Factorise, available

TOLERANCES = {"float64": 1e-6, "float32": 0.01}
"""At which warp_trunk's solution is compared [mm]."""


def main(
    arguments: Sequence[str] | None = None,
    problem: Problem | None = None,
    solvers: dict[str, Factorise] | None = None,
) -> None:
    """Compares, prints and writes; a problem or solvers given here go before those of the arguments."""
    given = _parser().parse_args(arguments)
    be_quiet()
    problem = problem or mesh_case(load_case(given.case), given.tets)
    problem = replace(problem, tissue=replace(problem.tissue, poisson_ratio=given.nu))
    trunk = problem.trunk
    solvers = solvers or available()
    best = next(iter(solvers))
    comparison = Comparison(problem, given.gravity, solvers[best])
    print(
        f"{problem.name}: {len(trunk.tets):,} tets, {len(trunk.nodes):,} nodes, "
        f"{int((~trunk.prescribed).sum()):,} free; nu {given.nu:g}, gravity {given.gravity:g} m/s^2; {best}"
    )
    moved = np.linalg.norm(comparison.truth - comparison.path.displacement, axis=1)
    print(f"the equilibrium is {moved.max():.1f} mm (mean {moved.mean():.1f}) from the spline's image")
    if given.out:
        _keep_solution(given.out, comparison)
    record: dict[str, Any] = {
        "case": problem.name,
        "tets": len(trunk.tets),
        "free_nodes": int((~trunk.prescribed).sum()),
        "poisson_ratio": given.nu,
        "gravity": given.gravity,
        "solver": best,
        "hardware": hardware("cpu"),
        "versions": {name: version(name) for name in ("scikit-fem", "numpy", "scipy", "warp-lang")},
        "distance_mm": {},
    }
    for precision, tolerance in TOLERANCES.items():
        distances = comparison.distances(comparison.simulated(precision, tolerance))
        record["distance_mm"][precision] = {"max": float(distances.max()), "mean": float(distances.mean())}
        print(
            f"warp_trunk in {precision}: nodes {distances.max():.2g} mm apart at most, {distances.mean():.2g} mean"
        )
    if given.solvers:
        record["linear"] = _linear(comparison, solvers)
    if given.json:
        _keep_record(given.json, record)


def _linear(comparison: Comparison, solvers: dict[str, Factorise]) -> list[dict[str, Any]]:
    """Times one linear solve by every solver."""
    print("\n| linear solver | set-up [s] | solve [s] | error of the step [mm] |\n|---|---|---|---|")
    runs = []
    for run in comparison.linear_runs(solvers):
        print(
            f"| {run.solver} | {run.setup_seconds:.2f} | {run.solve_seconds:.2f} | {run.error_mm:.0e} |",
            flush=True,
        )
        runs.append(asdict(run))
    return runs


def _keep_solution(path: Path, comparison: Comparison) -> None:
    """Mesh, motion of the bones and solution, for who wants to compare another model with it."""
    trunk = comparison.problem.trunk
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(
        path,
        nodes=trunk.nodes,
        tets=trunk.tets,
        bone=trunk.bone,
        skin_nodes=trunk.skin_nodes,
        bone_displacement=comparison.path.displacement,
        poisson_ratio=comparison.problem.tissue.poisson_ratio,
        gravity=comparison.gravity,
        displacement=comparison.truth,
    )


def _keep_record(path: Path, record: dict[str, Any]) -> None:
    """Adds the record to the list in a file, in the place of one of the same problem."""
    records = json.loads(path.read_text()) if path.exists() else []
    what = ("case", "tets", "poisson_ratio", "gravity")
    records = [other for other in records if any(other[key] != record[key] for key in what)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps([*records, record], indent=1) + "\n")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", help="case folder, or phantom")
    parser.add_argument("--tets", type=int, default=86_500, help="about so many tetrahedra")
    parser.add_argument("--nu", type=float, default=0.45, help="Poisson's ratio")
    parser.add_argument("--gravity", type=float, default=0.0, help="m/s^2, down")
    parser.add_argument("--out", type=Path, help="where to keep scikit-fem's solution, an npz")
    parser.add_argument("--json", type=Path, help="where to keep the record; others in the file stay")
    parser.add_argument("--solvers", action="store_true", help="time every linear solver")
    return parser


if __name__ == "__main__":
    main()
