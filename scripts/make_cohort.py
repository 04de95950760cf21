"""Virtual patients with an actual skin whose truth is known: a rehearsal of a study, of nobody.

    python scripts/make_cohort.py ANATOMY OUT --cases 12

ANATOMY holds skin.ply and bones/ of a straight trunk, as for make-case. Each patient is drawn, gets her curve as
make-case imposes it, and an actual skin by a model that differs from the default of `simulate`: a neo-Hookean
continuum in layers, ribs that follow, a finer mesh, and the noise of a scanner. Her truth stands in truth.json
beside the cases; case.toml says `virtual = true`. A patient who cannot be (her curve folds the trunk, her
landmarks are refused, her truth does not converge) is drawn again, and counted.
"""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from warp_trunk import (
    Case,
    InputError,
    Landmarks,
    MeshOptions,
    RelaxOptions,
    RelaxStatus,
    RunOptions,
    SpineCurve,
    Surface,
    make_case,
    predicted_skin,
    prepare,
    read_surface,
    simulate,
    write_case,
)  # fmt: skip
from warp_trunk.case import check_case
from warp_trunk.case.layers import Layers
from warp_trunk.case.study import Pose, Study
from warp_trunk.case.tissue_file import with_constants
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.geometry.normals import vertex_normals

KINDS = {"thoracic": 0.74, "double_major": 0.14, "thoracolumbar": 0.12}
"""Shares of curves among operated adolescents: half are Lenke 1 and every type occurs (1912 patients, Sponseller
et al., Harms Study Group); the split of the other half is assumed."""
LEFT = 0.1
"""Share of main curves that are convex to the left; assumed, as nearly all thoracic ones are right."""
COBB = (35.0, 90.0)
"""Uniform, so that all sizes are judged alike; operated curves have 46 to 78 degrees in the mean of a type (the
same study)."""
ROTATION = (0.32, 0.08)
"""Apical rotation over Cobb: 22 over 68 degrees in the mean (Brink et al. 2017); its deviation is assumed."""
SIZE = 0.04
"""Standard deviation of height, width and depth, each by itself; that of stature at one age."""
KYPHOSIS = 10.0
"""Standard deviation of what is added to the thoracic kyphosis [degrees]; assumed."""
CORRECTION = (0.70, 0.10)
"""Part of the curve that surgery takes away: 71 % in the mean (Mattila et al. 2013); its deviation is assumed."""
FAT = (6.0, 1.5)
"""Fat under the skin of the back [mm], mean and deviation (sources in `case.layers`)."""
MONTHS = (3.0, 24.0)
"""Months from surgery to the scan; uniform, assumed."""
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


@dataclass(frozen=True)
class Drawn:
    """One virtual patient."""

    kind: Literal["thoracic", "thoracolumbar", "double_major"]
    direction: Literal["right", "left"]
    cobb: float
    rotation: float
    height: float
    width: float
    depth: float
    kyphosis: float
    correction: float
    fat: float
    months: float
    constants: dict[str, float]
    """What her tissue and ribs truly are, by the names of tissue.toml."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """How the cohort is made."""

    anatomy: tyro.conf.Positional[Path]
    """Folder with skin.ply and bones/ of a straight trunk."""
    out: tyro.conf.Positional[Path]
    """Folder for the case folders."""
    cases: int = 12
    """How many patients."""
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
    """Also write each patient bending to her convex side before surgery, which takes half as much of her curve."""


def main(options: Options) -> None:
    """Writes the cases and truth.json."""
    skin = read_surface(options.anatomy / "skin.ply")
    if options.skin_edge:
        skin = coarsen(skin, options.skin_edge, 0.2 * options.skin_edge)
    bones = {path.stem: read_surface(path) for path in sorted((options.anatomy / "bones").glob("*.ply"))}
    known = {}
    for number in range(1, options.cases + 1):
        folder = options.out / f"virtual_{number:03d}"
        random = np.random.default_rng([options.seed, number])
        drawn, cases, attempts = patient(folder.name, skin, bones, options, random)
        for name, case in cases.items():
            write_case(folder.with_name(name), case)
        known[folder.name] = {"draws": attempts, **dataclasses.asdict(drawn)}
        (options.out / "truth.json").write_text(json.dumps(known, indent=2) + "\n")
        print(f"{folder.name}: {cases[folder.name].name}, {attempts} draws", flush=True)


def patient(
    name: str, skin: Surface, bones: dict[str, Surface], options: Options, random: np.random.Generator
) -> tuple[Drawn, dict[str, Case], int]:
    """One patient who can be, her cases by folder, and how many were drawn for her."""
    for attempt in range(1, MOST_TRIES + 1):
        drawn = draw(random, options)
        try:
            return drawn, made(name, drawn, skin, bones, options, random), attempt
        except InputError as error:
            if str(error).startswith(OF_ALL):
                raise
            print(f"{name}: drawn again, {error}", file=sys.stderr, flush=True)
    raise SystemExit(f"{name}: {MOST_TRIES} draws, none of which could be")


def draw(random: np.random.Generator, options: Options) -> Drawn:
    """One patient."""
    kind = random.choice(list(KINDS), p=list(KINDS.values()))
    cobb = float(random.uniform(*options.cobb))
    constants = {
        "poisson_ratio": float(random.uniform(0.43, 0.48)),
        "fat.youngs_modulus": float(2.5 * 1.5 ** random.standard_normal()),
        "ribs.recovery": float(random.uniform(0.6, 1.0)),
    }
    return Drawn(
        kind=kind,
        direction="left" if random.random() < LEFT else "right",
        cobb=cobb,
        rotation=cobb * max(0.05, float(random.normal(*ROTATION))),
        height=float(random.normal(1.0, SIZE)),
        width=float(random.normal(1.0, SIZE)),
        depth=float(random.normal(1.0, SIZE)),
        kyphosis=float(random.normal(0.0, KYPHOSIS)),
        correction=float(np.clip(random.normal(*CORRECTION), 0.4, 0.95)),
        fat=float(np.clip(random.normal(*FAT), 2.0, 12.0)),
        months=float(random.uniform(*MONTHS)),
        constants={**constants, **options.truth},
    )


def made(
    name: str,
    drawn: Drawn,
    skin: Surface,
    bones: dict[str, Surface],
    options: Options,
    random: np.random.Generator,
) -> dict[str, Case]:
    """The cases of one patient by the names of their folders.

    Raises:
        InputError: she cannot be, or her truth does not converge.
    """
    skin = shaped(skin, drawn)
    bones = {bone: shaped(surface, drawn) for bone, surface in bones.items()}
    curve = SpineCurve(kind=drawn.kind, cobb=drawn.cobb, apical_rotation=drawn.rotation, direction=drawn.direction)
    amounts: dict[str, tuple[Pose, float]] = {name: ("surgery", drawn.correction)}
    if options.bending:
        amounts[f"{name}_bending"] = ("bending", 0.5 * drawn.correction)
    cases = {}
    for folder, (pose, part) in amounts.items():
        title = f"virtual {drawn.kind} {drawn.cobb:.0f} degrees, {100 * part:.0f} % " + (
            "corrected" if pose == "surgery" else "bent away"
        )
        exact = make_case(skin, bones, curve, part, title)
        study = Study(
            patient=name, pose=pose, months_after=drawn.months if pose == "surgery" else None, virtual=True
        )
        exact = dataclasses.replace(exact, study=study, layers=Layers(fat_thickness=drawn.fat))
        actual = scanned(truth(with_constants(exact, drawn.constants), options), random)
        noisy = with_landmark_errors(exact, options.landmark_error, random)
        check_case(noisy)
        cases[folder] = dataclasses.replace(noisy, actual_skin=actual)
    return cases


def shaped(surface: Surface, drawn: Drawn) -> Surface:
    """A part of the straight trunk in the size and with the kyphosis of a patient.

    A bump from front to back over the height of the thorax adds to the kyphosis what its slopes turn at both ends.
    """
    x, y, z = (surface.vertices * [drawn.width, drawn.depth, drawn.height]).T
    low, high = THORAX[0] * drawn.height, THORAX[1] * drawn.height
    along = np.clip((z - low) / (high - low), 0.0, 1.0)
    amplitude = math.radians(drawn.kyphosis) * (high - low) / (2.0 * math.pi)
    return Surface(np.column_stack([x, y + amplitude * np.sin(math.pi * along) ** 2, z]), surface.faces)


THORAX = (1070.0, 1360.0)
"""Heights of T12 and T1 in the anatomy [mm], between which kyphosis is added."""


def truth(case: Case, options: Options) -> Surface:
    """The skin after surgery by the model that the cases are judged with."""
    run = RunOptions(
        mesh=options.mesh,
        simulation=SimulationOptions(increments=options.increments, relax=RelaxOptions(max_steps=MOST_STEPS)),
        energy="neo-hookean",
        layers="depth",
        bones="follow",
    )
    prepared = prepare(case, run)
    *_, last = simulate(prepared.model, prepared.bone_path, run.simulation)
    if last.relaxation.status is not RelaxStatus.CONVERGED:
        raise InputError(f"truth: ended {last.relaxation.status.name}")
    return predicted_skin(case, prepared.trunk, last.displacement)


def scanned(skin: Surface, random: np.random.Generator) -> Surface:
    """A skin as a scanner sees it: off along its normals, neighbours alike."""
    waves = random.standard_normal((200, 3)) / SCANNER_LENGTH
    phases = random.uniform(0.0, 2.0 * math.pi, 200)
    error = np.cos(skin.vertices @ waves.T + phases).sum(axis=1) * math.sqrt(2.0 / 200.0)
    return Surface(skin.vertices + SCANNER * error[:, None] * vertex_normals(skin), skin.faces)


def with_landmark_errors(case: Case, error: tuple[float, float], random: np.random.Generator) -> Case:
    """The case with landmarks that are off in any direction, by lengths of a gamma distribution."""
    mean, sd = error
    if not mean:
        return case
    moved = []
    for marks in (case.landmarks_before, case.planned_landmarks):
        way = random.standard_normal(marks.points.shape)
        length = random.gamma((mean / sd) ** 2, sd**2 / mean, len(way))
        off = length[:, None] * way / np.linalg.norm(way, axis=1, keepdims=True)
        off[[name.startswith("asis") for name in marks.names]] = 0.0  # they tell the frame
        moved.append(Landmarks(marks.names, marks.points + off))
    return dataclasses.replace(case, landmarks_before=moved[0], landmarks_after=moved[1])


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
