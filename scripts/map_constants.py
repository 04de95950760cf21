"""How near the energy itmsm comes to a continuum's, over its constants epsilon and theta.

    python scripts/map_constants.py CASE --out docs/constants

Every pair is simulated and compared with the neo-Hookean solution on the same mesh, which equals that of an
independent finite element package. Prints a table, writes a page, a JSON and a picture. Runs are kept in a
folder, so that it goes on where it was stopped; delete the folder when the engine has changed.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from benchmarking.prepare import load_case
from benchmarking.process import be_quiet
from benchmarking.tables import markdown
from choices.choices import Choices
from choices.difference import difference
from choices.map_picture import draw_map
from choices.rows import PAPERS
from choices.study import Study

EPSILON = (0.01, 0.1, 1.0, 10.0, 100.0)
THETA = (0.1, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 1e4)
WEIGHTS = ("count", "volume")
POISSON = (0.45, 0.49)
NAMES = {"mean_mm": "mean distance", "bsr_deg": "rotation"}
TOLERANCE = 0.1
"""Of every run [mm]; differences are millimetres. `tolerance_costs` says what 0.01 mm changes at the default."""
MORE = 20
"""Increments of a second attempt where one increment did not converge."""

PAGE = """# How near the energy itmsm comes to a continuum's: {case}

![Map of the table below]({picture})

Made by `scripts/map_constants.py`, {tets:,} tetrahedra, tolerance {tolerance:g} mm. Every pair of constants is
simulated with the weights of the papers, each edge, face and tetrahedron counting the same, and with weights by
the volume that each stands for, and compared with the neo-Hookean solution on the same mesh: mean and largest
distance of a point of the back, largest difference of the back surface rotation of a level from T1 to L5.

{table}
{best}"""


def main() -> None:
    """Simulates, compares, draws and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", help="a case folder, or phantom")
    parser.add_argument("--tets", type=int, default=Choices.tets)
    parser.add_argument("--threads", type=int, default=0, help="0 is all cores")
    parser.add_argument("--kept", type=Path, default=Path("results/choices"), help="where runs are kept")
    parser.add_argument("--out", type=Path, default=Path("docs/constants"), help="name without its ending")
    given = parser.parse_args()
    be_quiet()
    write_map(Study(load_case(given.case), given.kept, given.threads), given.out, given.tets)


def write_map(
    study: Study,
    out: Path,
    tets: int = Choices.tets,
    epsilons: Sequence[float] = EPSILON,
    thetas: Sequence[float] = THETA,
) -> None:
    """Simulates each pair of constants, and writes `out` with the endings .json, .png and .md."""
    start = replace(PAPERS, tets=tets, tolerance=TOLERANCE, increments=1)
    points = [
        point for weights in WEIGHTS for point in entries(study, replace(start, weights=weights), epsilons, thetas)
    ]
    record = {
        "case": study.case.name,
        "tets": study.ending(start).tets,
        "tolerance_mm": TOLERANCE,
        "tolerance_costs": tolerance_costs(study, start),
        "best": {
            f"weights {weights}, nu {nu:g}, by {NAMES[measure]}": best(points, weights, nu, measure)
            for weights in WEIGHTS
            for nu in POISSON
            for measure in NAMES
        },
        "points": points,
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    out.with_suffix(".json").write_text(json.dumps(record, indent=1, allow_nan=False) + "\n")
    draw_map(out.with_suffix(".png"), points, POISSON[0])
    nearest = "\n".join(f"- {name}: {near(name, point)}" for name, point in record["best"].items())
    text = table(points)
    page = PAGE.format(
        case=study.case.name,
        picture=f"{out.name}.png",
        tets=record["tets"],
        tolerance=TOLERANCE,
        table=text,
        best=f"Nearest, by the mean distance or by the rotation:\n\n{nearest}\n",
    )
    out.with_suffix(".md").write_text(page, encoding="utf-8")
    print(f"{text}\n{nearest}")


def near(name: str, point: dict[str, Any]) -> str:
    """The constants of a nearest pair and how near it comes."""
    away = point["against"][name.split(", ")[1]]
    return (
        f"epsilon {point['epsilon']:g}, theta {point['theta']:g}: mean {away['mean_mm']:.2f} mm, "
        f"max {away['max_mm']:.2f} mm, BSR {away['bsr_deg']:.2f} degrees at {away['level']}"
    )


def entries(
    study: Study, start: Choices, epsilons: Sequence[float], thetas: Sequence[float]
) -> list[dict[str, Any]]:
    """Every pair of constants and how far its skin is from each neo-Hookean one."""
    truths = {
        nu: study.ending(replace(start, energy="neo-hookean", weights="count", poisson_ratio=nu)) for nu in POISSON
    }
    found = []
    for epsilon in epsilons:
        for theta in thetas:
            choices = replace(start, epsilon=epsilon, theta=theta)
            ending = study.ending(choices)
            if ending.status != "CONVERGED":
                choices = replace(choices, increments=MORE)
                ending = study.ending(choices)
            against = {
                f"nu {nu:g}": asdict(difference(ending.skin, truth.skin, study.case.planned_landmarks))
                for nu, truth in truths.items()
            }
            found.append(
                {
                    "weights": start.weights,
                    "epsilon": epsilon,
                    "theta": theta,
                    "against": against,
                    "volume_percent": ending.volume_change,
                    "status": ending.status,
                    "increments": choices.increments,
                    "linear_iterations": ending.linear_iterations,
                }
            )
    return found


def tolerance_costs(study: Study, start: Choices) -> dict[str, Any]:
    """How far the default pair is at the tolerance of the map from itself at a tenth of it."""
    fine = study.ending(replace(start, tolerance=TOLERANCE / 10.0))
    return asdict(difference(study.ending(start).skin, fine.skin, study.case.planned_landmarks))


def best(points: list[dict[str, Any]], weights: str, nu: float, measure: str) -> dict[str, Any]:
    """The pair that comes nearest."""
    of_weights = [point for point in points if point["weights"] == weights and point["status"] == "CONVERGED"]
    return min(of_weights, key=lambda point: point["against"][f"nu {nu:g}"][measure])


def table(points: list[dict[str, Any]]) -> str:
    """Every entry as Markdown."""
    rows = []
    for point in points:
        near = [
            f"{away['mean_mm']:.2f} / {away['max_mm']:.1f} / {away['bsr_deg']:.2f}"
            for away in point["against"].values()
        ]
        pair = f"{point['epsilon']:g}, {point['theta']:g}"
        rows.append(
            [
                point["weights"],
                pair,
                *near,
                f"{point['volume_percent']:+z.2f}",
                str(point["linear_iterations"]),
                point["status"],
            ]
        )
    against = [f"nu {nu:g}: mean / max [mm] / BSR [degrees]" for nu in POISSON]
    return markdown(["weights", "epsilon, theta", *against, "volume [%]", "linear iterations", "ends"], rows)


if __name__ == "__main__":
    main()
