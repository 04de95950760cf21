"""Synthetic patients with an actual skin whose truth is known, to rehearse a study.

    python scripts/make_cohort.py ANATOMY OUT --cases 12

ANATOMY holds skin.ply and bones/ of a straight trunk, as for make-case. Each patient is drawn, gets her curve as
make-case imposes it, and an actual skin by a model that differs from the default of `simulate`: a neo-Hookean
continuum in layers, ribs that follow, a finer mesh, and the noise of a scanner. Her truth stands in truth.json
beside the cases; case.toml says `synthetic = true`. A patient who cannot be (her curve folds the trunk, her
landmarks are refused, her truth does not converge) is drawn again, and counted.
"""

import dataclasses
import json
import math
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tyro
from synthetic_patient import COBB, Drawn, curve_of, draw, leaning, part_of, shaped, with_landmark_errors
from trunks import read_trunk

from warp_trunk import Case, Execution, InputError, RunOptions, Surface, make_case, simulate, write_case
from warp_trunk.case import check_case
from warp_trunk.case.case import Pose, Study
from warp_trunk.case.layers import Layers
from warp_trunk.case.tissue_file import with_constants
from warp_trunk.engine.relaxation import RelaxOptions
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.geometry.surface import vertex_normals
from warp_trunk.meshing import MeshOptions

SCANNER = 1.4
"""Root mean square error of the scanned skin [mm], accuracy of both papers' scanner over a mannequin ..."""
SCANNER_LENGTH = 25.0
"""... and over which length it is alike [mm]; assumed."""
OF_ALL = ("tets:", "mesh:", "bone", "skin")
"""How refusals begin that another draw would not escape."""
MOST_STEPS = 60
"""Steps of a relaxation; a truth that needs more is at the edge of what the model can do."""
MOST_TRIES = 20
"""Draws of one patient before it is given up."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """How the cohort is made."""

    anatomy: tyro.conf.Positional[Path]
    """Folder with skin.ply and bones/ of a straight trunk."""
    out: tyro.conf.Positional[Path]
    """Folder for the case folders."""
    cases: int = 12
    """How many patients."""
    first: int = 1
    """Number of the first of them, so that several computers can make one cohort."""
    seed: int = 1
    """Of all draws."""
    truth: dict[str, float] = field(default_factory=dict)
    """Constants that all patients share, such as `poisson_ratio 0.47`; others are drawn for each."""
    mesh: MeshOptions = field(default_factory=lambda: MeshOptions(tets=350_000))
    """The mesh that makes the actual skin; simulate with a coarser one."""
    increments: int = 4
    """Parts in which her correction is applied."""
    skin_edge: float = 0.0
    """Coarsen the skin to edges of this length [mm], for small meshes; 0 leaves it."""
    landmark_error: tuple[float, float] = (2.1, 1.5)
    """Mean and deviation of the length of a landmark's error, before and after each [mm]: the papers'."""
    cobb: tuple[float, float] = COBB
    """Least and largest Cobb angle [degrees]."""
    bending: bool = False
    """Also write each patient bending sideways before surgery, to her convex side: curve and trunk lean."""


def main(options: Options) -> None:
    """Writes the cases and truth.json."""
    skin, bones = read_trunk(options.anatomy)
    if options.skin_edge:
        skin = coarsen(skin, options.skin_edge, 0.2 * options.skin_edge)
    truth = {}
    for number in range(options.first, options.first + options.cases):
        folder = options.out / f"virtual_{number:03d}"
        random = np.random.default_rng([options.seed, number])
        drawn, cases, attempts = patient(folder.name, skin, bones, options, random)
        for name, case in cases.items():
            write_case(folder.with_name(name), case)
        truth[folder.name] = {"draws": attempts, **dataclasses.asdict(drawn)}
        (options.out / "truth.json").write_text(json.dumps(truth, indent=2) + "\n", encoding="utf-8", newline="\n")
        print(f"{folder.name}: {cases[folder.name].name}, {attempts} draws", flush=True)


def patient(
    name: str, skin: Surface, bones: dict[str, Surface], options: Options, random: np.random.Generator
) -> tuple[Drawn, dict[str, Case], int]:
    """One patient who can be, her cases by folder, and how many were drawn for her."""
    for attempt in range(1, MOST_TRIES + 1):
        drawn = draw(random, cobb=options.cobb, truth=options.truth, bending=options.bending)
        try:
            return drawn, made(name, drawn, skin, bones, options=options, random=random), attempt
        except InputError as error:
            if str(error).startswith(OF_ALL):
                raise
            print(f"{name}: drawn again, {error}", file=sys.stderr, flush=True)
    raise SystemExit(f"{name}: {MOST_TRIES} draws, none of which could be")


def made(
    name: str,
    drawn: Drawn,
    skin: Surface,
    bones: dict[str, Surface],
    *,
    options: Options,
    random: np.random.Generator,
) -> dict[str, Case]:
    """The cases of one patient by the names of their folders.

    Raises:
        InputError: she cannot be, or her truth does not converge.
    """
    skin = shaped(skin, drawn)
    bones = {bone: shaped(surface, drawn) for bone, surface in bones.items()}
    curve = curve_of(drawn)
    poses: dict[str, Pose] = {name: "surgery"}
    if options.bending:
        poses[f"{name}_bending"] = "bending"
    cases = {}
    for folder, pose in poses.items():
        exact = posed(name, pose, drawn, make_case(skin, bones, curve, part_of(drawn, pose)))
        actual = scanned(truth(with_constants(exact, drawn.constants), options), random)
        noisy = with_landmark_errors(exact, options.landmark_error, random)
        check_case(noisy)
        cases[folder] = dataclasses.replace(noisy, actual_skin=actual)
    return cases


def posed(name: str, pose: Pose, drawn: Drawn, case: Case) -> Case:
    """The case of a patient with what a study knows of it; bending, her spine leans beside what it does."""
    went = f"{100 * part_of(drawn, pose):.0f} % " + ("corrected" if pose == "surgery" else "bent out")
    after = case.planned_landmarks
    if pose == "bending" and drawn.lean is not None:
        after = leaning(after, drawn.lean if drawn.direction == "left" else -drawn.lean)
    return dataclasses.replace(
        case,
        name=f"synthetic {drawn.kind} {drawn.cobb:.0f} degrees, {went}",
        landmarks_after=after,
        study=Study(
            patient=name, pose=pose, months_after=drawn.months if pose == "surgery" else None, synthetic=True
        ),
        layers=Layers(fat_thickness=drawn.fat),
    )


def truth(case: Case, options: Options) -> Surface:
    """The skin after surgery by the model that the cases are judged with."""
    run = RunOptions(
        mesh=options.mesh,
        simulation=SimulationOptions(increments=options.increments, relax=RelaxOptions(max_steps=MOST_STEPS)),
        energy="neo-hookean",
        layers="depth",
        bones="follow",
    )
    result = simulate(case, None, run, Execution(record=False), warnings=())
    if not result.converged:
        raise InputError(f"truth: ended {result.status.name}")
    return result.skin


def scanned(skin: Surface, random: np.random.Generator) -> Surface:
    """A skin as a scanner sees it: off along its normals, neighbours alike."""
    waves = random.standard_normal((200, 3)) / SCANNER_LENGTH
    phases = random.uniform(0.0, 2.0 * math.pi, 200)
    error = np.cos(skin.vertices @ waves.T + phases).sum(axis=1) * math.sqrt(2.0 / 200.0)
    return Surface(skin.vertices + SCANNER * error[:, None] * vertex_normals(skin), skin.faces)


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
