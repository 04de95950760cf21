"""How near an imported case is to the one that its label map was made of.

Usage: python scripts/check_import.py TRUE_CASE IMPORTED [IMPORTED ...] [--simulate CACHE_FOLDER]

TRUE_CASE is what `scripts/voxelise_case.py` was given, IMPORTED what `warp-trunk import` made. Prints distances of
surfaces, volumes, names and landmarks; with --simulate the back surface rotation predicted on both, with the
vertebrae of both moved as in the true case.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from warp_trunk import Case, Landmarks, MeshOptions, RunOptions, Surface, find_landmarks, read_case, run_case
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.surface_checks import enclosed_volume
from warp_trunk.results.summary import Rotations


def main() -> None:
    """Prints a table for each imported case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("true", type=Path)
    parser.add_argument("imported", type=Path, nargs="+")
    parser.add_argument("--simulate", type=Path, help="folder for the results")
    parser.add_argument("--tets", type=int, default=225_000)
    given = parser.parse_args()
    true = read_case(given.true)
    known = find_landmarks(true.bones).landmarks
    for folder in given.imported:
        made = read_case(folder)
        print(f"\n## {folder.name}")
        surfaces(true, made)
        landmarks(known, made.landmarks_before)
    if given.simulate:
        cases = [true, *(read_case(folder) for folder in given.imported)]
        rotations = [predicted(case, true, given.simulate / f"{i}", given.tets) for i, case in enumerate(cases)]
        for folder, (before, after) in zip(given.imported, rotations[1:], strict=True):
            print(f"\n## {folder.name}: back surface rotation off that of the true surfaces [degrees]")
            for what, one, other in (("before", before, rotations[0][0]), ("predicted", after, rotations[0][1])):
                known = {n: v for n, v in other.items() if v is not None}
                off = {n: v - known[n] for n, v in one.items() if v is not None and n in known}
                worst = max(off, key=lambda n: abs(off[n]))
                mean = np.mean(np.abs(list(off.values())))
                missing = [n for n in known if one.get(n) is None]
                print(
                    f"{what}: {len(off)} levels, mean {mean:.2f}, largest {off[worst]:+.2f} at {worst}; "
                    f"missing {missing}"
                )


def surfaces(true: Case, made: Case) -> None:
    """Distances of bones and of the skin, both ways, and volumes."""
    print(
        "missing:", sorted(set(true.bones) - set(made.bones)), "more:", sorted(set(made.bones) - set(true.bones))
    )
    rows = [(name, made.bones[name], true.bones[name]) for name in made.bones if name in true.bones]
    bones = [distances(one, other) for _, one, other in rows]
    print(
        "bones, from the truth: mean {:.3f} (worst bone {:.3f}), largest {:.2f} mm".format(*_of(rows, bones, 0, 1))
    )
    print(
        "bones, truth from them: mean {:.3f} (worst bone {:.3f}), largest {:.2f} mm".format(
            *_of(rows, bones, 2, 3)
        )
    )
    volumes = {name: enclosed_volume(one) / enclosed_volume(other) - 1.0 for name, one, other in rows}
    worst = max(volumes, key=lambda n: abs(volumes[n]))
    print(f"volumes: worst {100 * volumes[worst]:+.2f} % ({worst})")
    skin = distances(made.skin, true.skin)
    print("skin: mean {:.3f}, largest {:.2f}; the truth from it {:.3f}, {:.2f} mm".format(*skin))


def distances(one: Surface, other: Surface) -> tuple[float, float, float, float]:
    """Mean and largest distance of the vertices of one from the other, then the other way round [mm]."""
    there = np.abs(SurfaceDistance(other).at(one.vertices))
    back = np.abs(SurfaceDistance(one).at(other.vertices))
    return float(there.mean()), float(there.max()), float(back.mean()), float(back.max())


def _of(rows: list, bones: list, mean: int, most: int) -> tuple[float, float, float]:
    values = np.array(bones)
    name = rows[int(values[:, most].argmax())][0]
    print(f"({name})", end=" ")
    return float(values[:, mean].mean()), float(values[:, mean].max()), float(values[:, most].max())


def landmarks(known: Landmarks, made: Landmarks) -> None:
    """Landmarks against those found on the true bones."""
    both = [name for name in known.names if name in made.names]
    off = np.array([np.linalg.norm(known.point(name) - made.point(name)) for name in both])
    worst = both[int(off.argmax())]
    print(
        f"landmarks: {len(both)} of {len(known.names)}, mean {off.mean():.2f}, 95 % {np.percentile(off, 95):.2f}, "
        f"largest {off.max():.2f} mm ({worst})"
    )


def predicted(case: Case, true: Case, out: Path, tets: int) -> tuple[Rotations, Rotations]:
    """Back surface rotation before and after the surgery of the true case, with the landmarks of this one."""
    after = case.landmarks_before.points.copy()
    for vertebra in true.landmarks_before.vertebrae():
        motion = fit_rigid(
            true.landmarks_before.of_bone(vertebra).points, true.planned_landmarks.of_bone(vertebra).points
        )
        own = [i for i, name in enumerate(case.landmarks_before.names) if name.startswith(f"{vertebra}_")]
        after[own] = motion.apply(after[own])
    planned = replace(case, landmarks_after=Landmarks(case.landmarks_before.names, after), posture="standing")
    result = run_case(planned, out, RunOptions(mesh=MeshOptions(tets=tets), record=False))
    return result.summary.bsr_deg.before, result.summary.bsr_deg.after


if __name__ == "__main__":
    main()
