"""Does the answer depend on the number of increments? Theorem 2 of [2], measured.

Usage: python scripts/compare_increments.py CASE [TETS]

Simulates a case in 1, 5, 10 and 20 increments and compares the skins and the back surface rotations with
those of 20 increments; then again with bones that follow splines composed increment by increment.
"""

from __future__ import annotations

import sys

import numpy as np

from warp_trunk import MeshOptions, build_model, build_trunk, measure, read_case, simulate
from warp_trunk.bone_motion.bone_path import BonePath, composed_path, spline_path
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.results import predicted_skin

COUNTS = (20, 10, 5, 1)


def main(folder: str, tets: int = 225_000) -> None:
    """Prints the table for the case in a folder."""
    case = read_case(folder)
    trunk = build_trunk(case.skin, case.bones, MeshOptions(tets=tets))
    model = build_model(trunk, case.tissue, energy="itmsm", skin_rigidity=0.0)
    landmarks = (case.landmarks_before, case.planned_landmarks)

    def run(path: BonePath, increments: int) -> tuple[np.ndarray, np.ndarray]:
        *_, last = simulate(model, path, SimulationOptions(increments=increments))
        skin = predicted_skin(case, trunk, last.displacement)
        rotation = measure(skin, case.planned_landmarks).bsr
        return skin.vertices, np.array([np.nan if value is None else value for value in rotation.values()])

    print("bones            increments   skin max [mm]   skin mean [mm]   BSR max [degrees]")
    one_spline = spline_path(trunk.nodes, *landmarks)
    reference = run(one_spline, COUNTS[0])
    for name, paths in (
        ("one spline", {count: one_spline for count in COUNTS[1:]}),
        ("composed splines", {count: composed_path(trunk.nodes, *landmarks, count) for count in COUNTS[:-1]}),
    ):
        for count, path in paths.items():
            skin, rotation = run(path, count)
            distance = np.linalg.norm(skin - reference[0], axis=1)
            print(
                f"{name:16} {count:10d} {distance.max():15.4f} {distance.mean():16.4f} "
                f"{np.nanmax(np.abs(rotation - reference[1])):19.4f}",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1], *(int(value) for value in sys.argv[2:3]))
