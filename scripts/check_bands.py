"""Bands against whole simulations with drawn landmarks: are the standard deviations right?

    python scripts/check_bands.py CASE --draws 200 --out docs/bands

Of all sources of error only the landmarks are drawn, before and after each on its own, with the lengths that the
papers state. Prints a table, and writes it as a page. Bands take `--band-draws` linear solves; every draw here is
a simulation of its own, from meshed trunk to measured skin.
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
    Relaxer,
    RunOptions,
    SimulationOptions,
    TrunkMesh,
    measure,
    predicted_skin,
    prepare,
    sensitivities,
    simulate,
)
from warp_trunk.case.uncertainty import CERTAIN
from warp_trunk.run.bands import DRAWS, find_bands
from warp_trunk.run.paths import find_path

LANDMARKS_ONLY = replace(CERTAIN, landmark_error=LANDMARK_MEAN, landmark_error_sd=LANDMARK_SD)
PAGE = """# Bands against whole simulations: {case}

Made by `scripts/check_bands.py`: {draws} simulations of {tets} tetrahedra ({energy}), each with errors of
{mean:g} ± {sd:g} mm of every landmark before and after, drawn independently; back surface rotation of every level.
So many draws know a standard deviation to {known:.0%}. *Of the same draws* is what the sensitivities say of the
very errors that were drawn.

{table}
"""


@dataclass(frozen=True)
class Checked:
    """One level."""

    level: str
    """Its name."""
    value: float
    """Rotation as predicted [degrees]."""
    linear: bool
    """Whether the band says that it changes in proportion."""
    band: float
    """Standard deviation that the band gives [degrees]."""
    drawn: float
    """Standard deviation over the simulations [degrees]."""
    same: float
    """What the sensitivities give for the same draws [degrees]."""


def check(
    case: Case, options: RunOptions, draws: int, *, trunk: TrunkMesh | None = None, band_draws: int = DRAWS
) -> list[Checked]:
    """Bands of a case, and its simulations with drawn landmarks."""
    case = replace(case, uncertainty=LANDMARKS_ONLY)
    prepared = prepare(case, options, trunk)
    relaxer = Relaxer(prepared.model, options.simulation.relax)
    *_, last = simulate(prepared.model, prepared.bone_path, options.simulation, relaxer=relaxer)
    bands = find_bands(case, prepared, last, options, draws=band_draws).bands
    straight = [s for s in sensitivities(case, prepared, last, options) if s.name.startswith("bsr")]
    random = np.random.default_rng(5)
    rotations, said = [], []
    for number in range(draws):
        moved = replace(
            case,
            landmarks_before=moved_landmarks(case.landmarks_before, random),
            landmarks_after=moved_landmarks(case.planned_landmarks, random),
        )
        path = find_path(moved, prepared.trunk, options)
        *_, end = simulate(prepared.model, path, options.simulation, relaxer=relaxer)
        measured = measure(predicted_skin(case, prepared.trunk, end.displacement), moved.planned_landmarks)
        rotations.append([measured.bsr[s.name.removeprefix("bsr ")] for s in straight])
        errors = [
            there.points - here.points
            for there, here in (
                (moved.landmarks_before, case.landmarks_before),
                (moved.planned_landmarks, case.planned_landmarks),
            )
        ]
        said.append(
            [np.vdot(s.landmarks_before, errors[0]) + np.vdot(s.landmarks_after, errors[1]) for s in straight]
        )
        print(f"{number + 1} of {draws}: {end.relaxation.status.name}", flush=True)
    drawn = np.nanstd(np.array(rotations, dtype=np.float64), axis=0)
    same = np.std(said, axis=0)
    return [
        Checked(level, band.value, band.linear, band.sd, float(drawn[i]), float(same[i]))
        for i, (level, band) in enumerate(bands.bsr_deg.items())
    ]


def table(rows: list[Checked]) -> str:
    """The rows as Markdown, with the ratio of the band to what was drawn."""
    lines = [
        "| level | rotation | sd, band | sd, drawn | ratio | sensitivities, of the same draws | in proportion |",
        "|---|---:|---:|---:|---:|---:|---|",
    ]
    lines += [
        f"| {r.level} | {r.value:.2f} | {r.band:.2f} | {r.drawn:.2f} | {r.band / r.drawn:.2f} | {r.same:.2f} | "
        f"{'yes' if r.linear else 'no'} |"
        for r in rows
    ]
    worst = max(rows, key=lambda r: abs(r.band / r.drawn - 1.0))
    return "\n".join([*lines, "", f"Farthest: {worst.level}, {100.0 * (worst.band / worst.drawn - 1.0):+.0f} %."])


def page(case: Case, options: RunOptions, tets: int, draws: int, rows: list[Checked]) -> str:
    """The table with how it was made."""
    return PAGE.format(
        case=case.name,
        draws=draws,
        tets=f"{tets:,}",
        energy=options.energy,
        mean=LANDMARK_MEAN,
        sd=LANDMARK_SD,
        known=(2.0 * draws) ** -0.5,
        table=table(rows),
    )


def main() -> None:
    """Simulates, compares and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", help="a case folder, or phantom")
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--band-draws", type=int, default=DRAWS)
    parser.add_argument("--tets", type=int, default=225_000)
    parser.add_argument("--energy", choices=("itmsm", "neo-hookean"), default="itmsm")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--out", type=Path, default=Path("docs/bands"), help="name without its ending")
    given = parser.parse_args()
    case = load_case(given.case)
    options = RunOptions(
        mesh=MeshOptions(tets=given.tets),
        energy=given.energy,
        device=given.device,
        simulation=SimulationOptions(increments=1),
    )
    rows = check(case, options, given.draws, band_draws=given.band_draws)
    text = page(case, options, given.tets, given.draws, rows)
    given.out.with_suffix(".md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
