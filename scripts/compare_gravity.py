"""What gravity changes, by rest state: python scripts/compare_gravity.py CASE [TETS]"""

from __future__ import annotations

import sys
import time
from typing import get_args

import numpy as np

from warp_trunk import (
    BonePath,
    Layers,
    MeshOptions,
    build_model,
    build_trunk,
    layered,
    measure,
    predicted_skin,
    read_case,
    sag_free,
    simulate,
    spline_path,
)
from warp_trunk.engine.energies.by_name import EnergyName

GRAVITY = 9.81


def main(folder: str, tets: int = 225_000) -> None:
    """Prints the table for the case in a folder, each scene against the same without gravity."""
    case = read_case(folder)
    trunk = build_trunk(case.skin, case.bones, MeshOptions(tets=tets))
    surgery = spline_path(trunk.nodes, case.landmarks_before, case.planned_landmarks)
    none = BonePath(np.zeros_like(trunk.nodes))
    layers = Layers()
    meshes = {
        "one": (trunk, case.tissue),
        "layers": (layered(trunk, layers, "depth"), layers.tissues(case.tissue)),
    }
    print(
        "| energy | tissue | rest | no surgery: max [mm] | surgery: skin max [mm] | skin mean [mm] | "
        "BSR max [degrees] | rest found in [s] | rounds |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for energy in get_args(EnergyName):
        for name, (mesh, tissue) in meshes.items():
            weightless = build_model(mesh, tissue, energy=energy, skin_rigidity=0.0)
            heavy = build_model(mesh, tissue, energy=energy, gravity=GRAVITY, skin_rigidity=0.0)
            start = time.perf_counter()
            found = sag_free(heavy)
            seconds = time.perf_counter() - start
            reference = None
            for rest, model in (("", weightless), ("scan", heavy), ("sag-free", found.model)):
                moved = 0.0
                if rest:
                    moved = np.linalg.norm(list(simulate(model, none))[-1].displacement, axis=1).max()
                skin = predicted_skin(case, trunk, list(simulate(model, surgery))[-1].displacement)
                rotation = measure(skin, case.planned_landmarks).bsr.values()
                now = skin.vertices, np.array([np.nan if value is None else value for value in rotation])
                reference = reference or now
                if not rest:
                    continue
                distance = np.linalg.norm(now[0] - reference[0], axis=1)
                turned = np.nanmax(np.abs(now[1] - reference[1]))
                spent = f"{seconds:.1f} | {found.rounds}" if rest == "sag-free" else " | "
                print(
                    f"| {energy} | {name} | {rest} | {moved:.4f} | {distance.max():.2f} | {distance.mean():.2f} | "
                    f"{turned:.2f} | {spent} |",
                    flush=True,
                )


if __name__ == "__main__":
    main(sys.argv[1], *(int(value) for value in sys.argv[2:3]))
