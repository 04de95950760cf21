"""Bands against whole simulations with drawn landmarks: are the standard deviations right?

    python scripts/check_bands.py CASE --draws 200 --out docs/bands

Of all sources of error only the landmarks are drawn, before and after each on its own, with the lengths that the
papers state. Prints a table, and writes it as a page. Bands take some thirty linear solves; every draw here is a
simulation of its own, from meshed trunk to measured skin.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from benchmarking.prepare import load_case
from choices.errors import LANDMARK_MEAN, LANDMARK_SD, moved_landmarks

from warp_trunk import (
    Case,
    MeshOptions,
    Patient,
    RelaxStatus,
    RunOptions,
    Sensitivity,
    SimulationOptions,
    TrunkMesh,
    cobb_angles,
    measure,
    patient_of,
    predicted_skin,
    sensitivities,
    simulate,
)
from warp_trunk.case.uncertainty import CERTAIN
from warp_trunk.geometry.normals import vertex_normals
from warp_trunk.run.bands import DRAWS, find_bands
from warp_trunk.run.prepare import prepare_plan
from warp_trunk.run.spine_bands import spine_measures

LANDMARKS_ONLY = replace(CERTAIN, landmark_error=LANDMARK_MEAN, landmark_error_sd=LANDMARK_SD)
PAGE = """# Bands against whole simulations: {case}

Made by `scripts/check_bands.py`: {draws} simulations of {tets} tetrahedra
({energy}, --bones {bones}), each with errors of {mean:g} ± {sd:g} mm of every landmark
before and after, drawn independently; {converged} of them
converged, and all are counted. So many draws know a standard deviation to {known:.0%}.

## The back: back surface rotation of every level [degrees]

*Of the same draws* is what the sensitivities say of the very errors that were drawn.

{table}

## The planned spine

Cobb angles are between the end vertebrae of the curve before surgery, apical rotation is that of its apex
[degrees]; they need no simulation.

{spine}

## The skin

Standard deviation of the places of the predicted skin along its normal: {skin}
"""


@dataclass(frozen=True)
class Checked:
    """One number."""

    name: str
    """Its name."""
    value: float
    """As predicted."""
    linear: bool
    """Whether the band says that it changes in proportion."""
    band: float
    """Standard deviation that the band gives."""
    drawn: float
    """Standard deviation over the simulations."""
    same: float | None = None
    """What the sensitivities give for the same draws; None where there is no such number."""


@dataclass(frozen=True)
class Check:
    """A whole comparison."""

    levels: list[Checked]
    """Back surface rotation."""
    spine: list[Checked]
    """Measures of the planned spine."""
    skin: np.ndarray
    """Deviation of each vertex by the bands over that of the simulations, shape (vertices,)."""
    tets: int
    """Of the mesh."""
    converged: int
    """Simulations that converged."""


@dataclass(frozen=True)
class Simulated:
    """What drawn landmarks led to; the first axis is that of the draws."""

    rotations: np.ndarray
    """Back surface rotation of each level [degrees]."""
    said: np.ndarray
    """What sensitivities say of how it changes [degrees]."""
    spines: np.ndarray
    """Measures of the planned spine."""
    skins: np.ndarray
    """Places of the vertices of the predicted skin [mm]."""
    converged: int
    """How many of the relaxations converged."""


def check(
    case: Case, options: RunOptions, draws: int, *, trunk: TrunkMesh | None = None, band_draws: int = DRAWS
) -> Check:
    """Bands of a case, and its simulations with drawn landmarks."""
    case = replace(case, uncertainty=LANDMARKS_ONLY)
    patient = patient_of(case, options, trunk)
    prepared = prepare_plan(patient, case)
    *_, last = simulate(patient.model, prepared.bone_path, options.simulation, relaxer=patient.relaxer)
    found = find_bands(case, prepared, last, options, draws=band_draws)
    straight = [s for s in sensitivities(case, prepared, last, options) if s.name.startswith("bsr")]
    drawn = simulate_drawn(case, patient, straight, [*found.bands.spine], draws=draws)
    sds = [np.nanstd(part, axis=0) for part in (drawn.rotations, drawn.said, drawn.spines)]
    normals = vertex_normals(predicted_skin(case, prepared.trunk, last.displacement))
    along = np.einsum("dvi,vi->dv", drawn.skins, normals).std(axis=0)
    return Check(
        levels=[
            Checked(level, band.value, band.linear, band.sd, float(sds[0][i]), float(sds[1][i]))
            for i, (level, band) in enumerate(found.bands.bsr_deg.items())
        ],
        spine=[
            Checked(name, band.value, band.linear, band.sd, float(sds[2][i]))
            for i, (name, band) in enumerate(found.bands.spine.items())
        ],
        skin=found.skin_sd / along,
        tets=len(prepared.trunk.tets),
        converged=drawn.converged,
    )


def simulate_drawn(
    case: Case, patient: Patient, straight: list[Sensitivity], names: list[str], *, draws: int
) -> Simulated:
    """Simulates drawn landmarks, for the rotations of these sensitivities and these measures of the spine.

    Raises:
        InputError: drawn landmarks for which there is no simulation.
    """
    random, curves = np.random.default_rng(5), cobb_angles(case.landmarks_before)
    rotations, said, spines, skins = [], [], [], []
    converged = 0
    cases = [
        replace(
            case,
            landmarks_before=moved_landmarks(case.landmarks_before, random),
            landmarks_after=moved_landmarks(case.planned_landmarks, random),
        )
        for _ in range(draws)
    ]
    options = patient.options.simulation
    for number, moved in enumerate(cases):
        path = prepare_plan(patient, moved).bone_path
        *_, end = simulate(patient.model, path, options, relaxer=patient.relaxer)
        before, after = moved.landmarks_before, moved.planned_landmarks
        skin = predicted_skin(case, patient.trunk, end.displacement)
        measured, spine = measure(skin, after), spine_measures(after, curves)
        rotations.append([measured.bsr[s.name.removeprefix("bsr ")] for s in straight])
        errors = before.points - case.landmarks_before.points, after.points - case.planned_landmarks.points
        said.append(
            [np.vdot(s.landmarks_before, errors[0]) + np.vdot(s.landmarks_after, errors[1]) for s in straight]
        )
        spines.append([spine.get(name, np.nan) for name in names])
        skins.append(skin.vertices.astype(np.float32))
        converged += end.relaxation.status is RelaxStatus.CONVERGED
        print(f"{number + 1} of {draws}: {end.relaxation.status.name}", flush=True)
    return Simulated(
        rotations=np.array(rotations, dtype=np.float64),
        said=np.array(said),
        spines=np.array(spines, dtype=np.float64),
        skins=np.array(skins),
        converged=converged,
    )


def table(rows: list[Checked]) -> str:
    """The rows as Markdown, with the ratio of the band to what was drawn."""
    lines = ["| | as predicted | sd, band | sd, drawn | ratio |", "|---|---:|---:|---:|---:|"]
    lines += [
        f"| {r.name} | {r.value:.2f} | {r.band:.2f} | {r.drawn:.2f} | {r.band / r.drawn:.2f} |" for r in rows
    ]
    if rows[0].same is not None:
        ends = [" sensitivities, of the same draws | in proportion |", "---:|---|"]
        ends += [f" {r.same:.2f} | {'yes' if r.linear else 'no'} |" for r in rows]
        lines = [line + end for line, end in zip(lines, ends, strict=True)]
    worst = max(rows, key=lambda r: abs(r.band / r.drawn - 1.0))
    return "\n".join([*lines, "", f"Farthest: {worst.name}, {100.0 * (worst.band / worst.drawn - 1.0):+z.0f} %."])


def skin_text(ratio: np.ndarray) -> str:
    """How the skin's deviations compare."""
    low, high = np.percentile(ratio, [5.0, 95.0])
    return f"that of the bands is {ratio.mean():.2f} times the drawn in the mean, {low:.2f} to {high:.2f} at 90 %."


def page(case: Case, options: RunOptions, draws: int, checked: Check) -> str:
    """The table with how it was made."""
    return PAGE.format(
        case=case.name,
        draws=draws,
        converged=checked.converged,
        tets=f"{checked.tets:,}",
        energy=options.energy_of_tissue,
        bones=options.bones,
        mean=LANDMARK_MEAN,
        sd=LANDMARK_SD,
        known=(2.0 * draws) ** -0.5,
        table=table(checked.levels),
        spine=table(checked.spine),
        skin=skin_text(checked.skin),
    )


def main() -> None:
    """Simulates, compares and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", help="a case folder, or phantom")
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--band-draws", type=int, default=DRAWS)
    parser.add_argument("--tets", type=int, default=225_000)
    parser.add_argument("--bones", choices=("follow", "spline"), default="follow")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--out", type=Path, default=Path("docs/bands"), help="name without its ending")
    given = parser.parse_args()
    case = load_case(given.case)
    options = RunOptions(
        mesh=MeshOptions(tets=given.tets),
        bones=given.bones,
        device=given.device,
        simulation=SimulationOptions(increments=1),
    )
    checked = check(case, options, given.draws, band_draws=given.band_draws)
    text = page(case, options, given.draws, checked)
    given.out.with_suffix(".md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
