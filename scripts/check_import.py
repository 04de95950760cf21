"""How near an imported case is to the one that its label map was made of.

Usage: python scripts/check_import.py TRUE_CASE IMPORTED [IMPORTED ...] [--simulate CACHE_FOLDER]

TRUE_CASE is what `scripts/voxelise_case.py` was given, IMPORTED what `warp-trunk import` made. Prints distances of
surfaces, volumes, names and landmarks; with --simulate the back surface rotation predicted on both, with the
vertebrae of both moved as in the true case.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from warp_trunk import Case, Landmarks, MeshOptions, RunOptions, Surface, find_landmarks, read_case, run_case
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.geometry.surface_checks import enclosed_volume
from warp_trunk.results.summary import Rotations

NEAR = 1.5
"""Points of a bone nearer than this to another true bone are left out [mm]: a voxel."""
DEEP = 10.0
"""No two true bones overlap as deep as this [mm]."""
ENOUGH = 0.01
"""Whether bones overlap is looked at only where the volume is off by more, relative."""
FINE = 1.5
"""Spacing of the points with which shared volume is counted [mm]."""


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
                    f"{what}: {len(off)} levels, mean {mean:.2f}, largest {off[worst]:+z.2f} at {worst}; "
                    f"missing {missing}"
                )


def surfaces(true: Case, made: Case) -> None:
    """Distances of bones and of the skin, both ways, and volumes.

    Where true bones overlap, or lie nearer to each other than `NEAR`, a voxel can carry the label of one only, and
    no label map holds the other's surface there. These places are found on the true bones alone, and counted.
    """
    print(
        "missing:", sorted(set(true.bones) - set(made.bones)), "more:", sorted(set(made.bones) - set(true.bones))
    )
    fields = {name: SurfaceDistance(bone) for name, bone in true.bones.items()}
    names = [name for name in made.bones if name in true.bones]
    sides = {
        "bones, from the truth": [(made.bones[name].vertices, name, fields[name]) for name in names],
        "bones, truth from them": [
            (true.bones[name].vertices, name, SurfaceDistance(made.bones[name])) for name in names
        ],
    }
    for what, rows in sides.items():
        every, alone, left_out = {}, {}, {}
        for points, name, field in rows:
            off = np.abs(field.at(points))
            free = others(points, name, fields) > NEAR
            every[name], alone[name] = off, off[free]
            left_out[name] = np.count_nonzero(~free)
        print(f"{what}: {told(alone)}; with the {sum(left_out.values())} points near other bones {told(every)}")
    over = {name: volume_beyond(made.bones[name], true.bones[name], name, fields) for name in names}
    worst = max(over, key=lambda n: abs(over[n]))
    print(f"volumes: worst {100 * over[worst]:+z.2f} % ({worst}) beyond what overlap explains")
    print("skin: mean {:.3f}, largest {:.2f}; the truth from it {:.3f}, {:.2f} mm".format(*skins(true, made)))


def others(points: np.ndarray, own: str, fields: Mapping[str, SurfaceDistance]) -> np.ndarray:
    """Distance of points from the nearest true bone but their own, negative inside; `NEAR` + 1 beyond [mm]."""
    away = np.full(len(points), NEAR + 1.0)
    for name, field in fields.items():
        close = ((points > field.lower - NEAR) & (points < field.upper + NEAR)).all(axis=1)
        if name == own or not close.any():
            continue
        away[close] = np.fmin(away[close], field.at(points[close], DEEP))
    return away


def told(off: Mapping[str, np.ndarray]) -> str:
    """Mean over bones, the worst bone's mean, and the largest distance with its bone."""
    means = {name: float(values.mean()) for name, values in off.items()}
    most = {name: float(values.max()) for name, values in off.items()}
    worst, far = max(means, key=lambda n: means[n]), max(most, key=lambda n: most[n])
    return (
        f"mean {np.mean([*means.values()]):.3f} (worst bone {means[worst]:.3f}, {worst}), "
        f"largest {most[far]:.2f} mm ({far})"
    )


def volume_beyond(made: Surface, true: Surface, name: str, fields: Mapping[str, SurfaceDistance]) -> float:
    """By how much of the true volume a bone is larger than it, or smaller than it without what it shares."""
    whole, found = enclosed_volume(true), enclosed_volume(made)
    if abs(found / whole - 1.0) < ENOUGH:
        return found / whole - 1.0
    own = fields[name]
    grid = [np.arange(low, high, FINE) for low, high in zip(own.lower, own.upper, strict=True)]
    points = np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points[others(points, name, fields) < 0.0]
    shared = float(np.count_nonzero(own.at(points) < 0.0)) * FINE**3 if len(points) else 0.0
    return max(found - whole, 0.0) / whole + min(found - (whole - shared), 0.0) / whole


def skins(true: Case, made: Case) -> tuple[float, float, float, float]:
    """Mean and largest distance of the vertices of one from the other, then the other way round [mm]."""
    there = np.abs(SurfaceDistance(true.skin).at(made.skin.vertices))
    back = np.abs(SurfaceDistance(made.skin).at(true.skin.vertices))
    return float(there.mean()), float(there.max()), float(back.mean()), float(back.max())


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
