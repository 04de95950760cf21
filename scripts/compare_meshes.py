"""What refining the mesh changes of the skin, for each energy.

    python scripts/compare_meshes.py CASE --tets 145000 225000 500000 1000000 --out meshes.md

`phantom` stands for the built-in phantom. Every energy is relaxed to 0.001 mm on every mesh and compared with
the same energy on the finest one; skins share their vertices. Locking is what is left when the error of nu 0.45
is taken from that of nu 0.49, vertex by vertex. Prints and writes Markdown tables.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from benchmarking.prepare import load_case, mesh_case
from benchmarking.problem import compare_skins
from benchmarking.tables import markdown

from warp_trunk import Case, RelaxOptions, SimulationOptions, Surface, build_model, simulate

ENERGIES: dict[str, dict[str, Any]] = {
    "itmsm, weights by count": {},
    "itmsm, weights by volume": {"weights": "volume"},
    "neo-hookean, nu 0.45": {"energy": "neo-hookean", "poisson_ratio": 0.45},
    "neo-hookean, nu 0.49": {"energy": "neo-hookean", "poisson_ratio": 0.49},
}
LOCKED, FREE = "neo-hookean, nu 0.49", "neo-hookean, nu 0.45"
OPTIONS = SimulationOptions(increments=2, relax=RelaxOptions(tolerance=1e-3))


def main() -> None:
    """Measures and writes the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", help="a case folder, or phantom")
    parser.add_argument("--tets", nargs="+", type=int, default=[145_000, 225_000, 500_000, 1_000_000])
    parser.add_argument("--energies", nargs="+", choices=ENERGIES, default=list(ENERGIES))
    parser.add_argument("--out", type=Path, default=Path("meshes.md"), help="the table (default %(default)s)")
    given = parser.parse_args()
    case = load_case(given.case)
    skins = {tets: skins_of(case, tets, given.energies) for tets in given.tets}
    finest = skins[given.tets[-1]][1]
    rows = []
    for name in given.energies:
        for count, of_mesh in skins.values():
            away = compare_skins(of_mesh[name], finest[name], case.planned_landmarks)
            distances = (away.max_error_mm, away.mean_skin_error_mm, away.bsr_error_deg)
            rows.append([name, str(count), *(f"{value:.2f}" for value in distances)])
    header = ["energy", "tetrahedra", "skin max [mm]", "skin mean [mm]", "BSR max [degrees]"]
    table = markdown(header, rows)
    if {LOCKED, FREE} <= set(given.energies):
        table += f"\n{locking(list(skins.values()))}"
    given.out.write_text(table, encoding="utf-8")
    print(table)


def locking(skins: list[tuple[int, dict[str, Surface]]]) -> str:
    """The table of what locking costs on each mesh but the finest."""
    changes = [(count, of_mesh[LOCKED].vertices - of_mesh[FREE].vertices) for count, of_mesh in skins]
    rows = []
    for count, change in changes[:-1]:
        cost = np.linalg.norm(change - changes[-1][1], axis=1)
        rows.append([str(count), f"{cost.max():.2f}", f"{cost.mean():.2f}"])
    return markdown(["tetrahedra", "locking at nu 0.49, skin max [mm]", "mean [mm]"], rows)


def skins_of(case: Case, tets: int, energies: list[str]) -> tuple[int, dict[str, Surface]]:
    """Number of tetrahedra of a mesh, and the skin after surgery by energy."""
    problem = mesh_case(case, tets)
    path, skins = problem.bone_path(), {}
    for name in energies:
        options = dict(ENERGIES[name])
        tissue = replace(case.tissue, poisson_ratio=options.pop("poisson_ratio", case.tissue.poisson_ratio))
        *_, last = simulate(
            build_model(problem.trunk, tissue, **{"energy": "itmsm", "skin_rigidity": 0.0, **options}),
            path,
            OPTIONS,
        )
        skins[name] = problem.skin(last.displacement)
        spent = (
            f"{last.relaxation.status.name}, {last.relaxation.linear_iterations} iterations in the last increment"
        )
        print(f"{len(problem.trunk.tets)} tets, {name}: {spent}", flush=True)
    return len(problem.trunk.tets), skins


if __name__ == "__main__":
    main()
