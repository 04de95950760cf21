"""What epsilon and theta change of the skin: python scripts/compare_constants.py CASE [TETS]"""

from __future__ import annotations

import sys

import numpy as np

from warp_trunk import (
    MeshOptions,
    Tissue,
    build_model,
    build_trunk,
    measure,
    read_case,
    simulate,
    skin_after,
    spline_path,
)
from warp_trunk.trunk_mesh import tet_volumes

CONSTANTS = ((1.0, 10.0), (0.1, 10.0), (10.0, 10.0), (1.0, 1.0), (1.0, 100.0), (1.0, 1000.0), (1.0, 0.0))
"""Pairs of epsilon and theta; the first is what the others are compared with."""


def main(folder: str, tets: int = 225_000) -> None:
    """Prints the table for the case in a folder."""
    case = read_case(folder)
    trunk = build_trunk(case.skin, case.bones, MeshOptions(tets=tets))
    path = spline_path(trunk.nodes, case.landmarks_before, case.landmarks_after)
    volume = tet_volumes(trunk.nodes, trunk.tets).sum()
    reference = None
    print(
        "| epsilon, theta | skin max [mm] | skin mean [mm] | BSR max [degrees] | volume [%] | linear iterations |"
    )
    print("|---|---|---|---|---|---|")
    for epsilon, theta in CONSTANTS:
        increments = list(simulate(build_model(trunk, Tissue(epsilon=epsilon, theta=theta)), path))
        displacement = increments[-1].displacement
        skin = skin_after(case, trunk, displacement)
        rotation = measure(skin, case.landmarks_after).bsr.values()
        now = skin.vertices, np.array([np.nan if value is None else value for value in rotation])
        reference = reference or now
        distance = np.linalg.norm(now[0] - reference[0], axis=1)
        turned = np.nanmax(np.abs(now[1] - reference[1]))
        grown = 100.0 * (tet_volumes(trunk.nodes + displacement, trunk.tets).sum() / volume - 1.0)
        spent = sum(increment.relaxation.linear_iterations for increment in increments)
        print(
            f"| {epsilon:g}, {theta:g} | {distance.max():.1f} | {distance.mean():.1f} | {turned:.1f} | "
            f"{grown:+.2f} | {spent} |",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1], *(int(value) for value in sys.argv[2:3]))
