"""What skin, fat and muscle change of the skin against one tissue: python scripts/compare_layers.py CASE [TETS]"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import get_args

import numpy as np

from warp_trunk import (
    Layers,
    MeshOptions,
    RunOptions,
    build_trunk,
    measure,
    predicted_skin,
    prepare,
    read_case,
    simulate,
)
from warp_trunk.engine.energies.by_name import EnergyName

SCENES = {
    "skin, fat, muscle": Layers(),
    "skin, no fat": Layers(fat_thickness=0.0),
    "fat, no skin": Layers(skin_thickness=0.0),
    "fat of 12 mm": Layers(fat_thickness=12.0),
    "skin of 56 kPa": Layers(constants={"skin": {"youngs_modulus": 56.0}}),
    "muscle of 3 kPa": Layers(constants={"muscle": {"youngs_modulus": 3.0}}),
    "muscle of 30 kPa": Layers(constants={"muscle": {"youngs_modulus": 30.0}}),
}


def main(folder: str, tets: int = 225_000) -> None:
    """Prints the table for the case in a folder, each energy against its own uniform tissue."""
    case = read_case(folder)
    trunk = build_trunk(case.skin, case.bones, MeshOptions(tets=tets))
    print("| energy | tissue | skin max [mm] | skin mean [mm] | BSR max [degrees] | linear iterations |")
    print("|---|---|---|---|---|---|")
    for energy in get_args(EnergyName):
        reference = None
        for name, layers in {"one": None, **SCENES}.items():
            options = RunOptions(energy=energy, layers="none" if layers is None else "depth")
            prepared = prepare(replace(case, layers=layers), options, trunk)
            increments = list(simulate(prepared.model, prepared.bone_path))
            skin = predicted_skin(case, trunk, increments[-1].displacement)
            rotation = measure(skin, case.planned_landmarks).bsr.values()
            now = skin.vertices, np.array([np.nan if value is None else value for value in rotation])
            reference = reference or now
            distance = np.linalg.norm(now[0] - reference[0], axis=1)
            turned = np.nanmax(np.abs(now[1] - reference[1]))
            spent = sum(increment.relaxation.linear_iterations for increment in increments)
            print(
                f"| {energy} | {name} | {distance.max():.1f} | {distance.mean():.1f} | {turned:.1f} | {spent} |",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1], *(int(value) for value in sys.argv[2:3]))
