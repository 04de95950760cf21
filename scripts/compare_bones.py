"""Bones that bend with the spline against bones that move rigidly, measured.

Usage: python scripts/compare_bones.py CASE [TETS]

Prints how the spline changes the shape of each bone, then simulates the case both ways: how the relaxation
ends, the back surface rotation, and how far the skins are from each other. Bones known after surgery, where the
case has any, are a third way.
"""

from __future__ import annotations

import sys

import numpy as np

from warp_trunk import MeshOptions, Surface, build_model, build_trunk, measure, read_case, simulate, spline_path
from warp_trunk.articulation import bone_motions
from warp_trunk.bone_path import BonePath, rigid_path
from warp_trunk.joints import free_joints
from warp_trunk.results import skin_after
from warp_trunk.rigid import fit_rigid
from warp_trunk.trunk_mesh import TrunkMesh


def main(folder: str, tets: int = 225_000) -> None:
    """Prints both tables for the case in a folder."""
    case = read_case(folder)
    landmarks = (case.landmarks_before, case.landmarks_after)
    print("bone                   spline: from rigid, rms / max [mm]   edges shorter / longer [%]")
    for name, bone in case.bones.items():
        after = bone.vertices + spline_path(bone.vertices, *landmarks).displacement
        off = np.linalg.norm(fit_rigid(bone.vertices, after).apply(bone.vertices) - after, axis=1)
        change = 100.0 * (_edge_lengths(bone, after) / _edge_lengths(bone, bone.vertices) - 1.0)
        print(
            f"{name:22} {np.sqrt(np.mean(off**2)):20.2f} {off.max():8.2f} {change.min():19.1f} {change.max():6.1f}"
        )

    trunk = build_trunk(case.skin, case.bones, MeshOptions(tets=tets))
    free = free_joints(trunk)
    spline = spline_path(trunk.nodes, *landmarks)
    ways: dict[str, tuple[TrunkMesh, BonePath]] = {
        "spline": (trunk, spline),
        "rigid": (free, rigid_path(free, bone_motions(case.bones, *landmarks), spline)),
    }
    if case.bones_after:
        known = bone_motions(case.bones, *landmarks, case.bones_after)
        ways["known after"] = (free, rigid_path(free, known, spline))
    released = int((trunk.bone >= 0).sum() - (free.bone >= 0).sum())
    print(f"\njoints: {released} of {(trunk.bone >= 0).sum()} nodes on bone are freed")
    torn = _stretch(trunk, rigid_path(trunk, bone_motions(case.bones, *landmarks), spline).displacement)
    print(f"edges between two bones would stretch to {torn:.2f} times their length, were they held")
    print("\nbones         ends        linear iterations   inverted   joints stretch   max BSR [degrees]   skin")
    skins: dict[str, Surface] = {}
    for way, (mesh, path) in ways.items():
        increments = list(simulate(build_model(mesh, case.tissue), path))
        last = increments[-1]
        skins[way] = skin_after(case, mesh, last.displacement)
        off = np.linalg.norm(skins[way].vertices - skins["spline"].vertices, axis=1)
        worst = max(increments, key=lambda increment: increment.relaxation.estimated_error)
        print(
            f"{way:13} {last.relaxation.status.name:10}"
            f" {sum(increment.relaxation.linear_iterations for increment in increments):10d}"
            f" {last.relaxation.inverted_tets:18d} {_stretch(trunk, last.displacement):14.2f}"
            f" {measure(skins[way], landmarks[1], case.skin).max_thoracic_bsr:16.2f}"
            f"   max {off.max():.1f} mean {off.mean():.1f} mm from the spline's"
            f"   (worst increment {worst.number}, {worst.relaxation.status.name})",
            flush=True,
        )


def _edge_lengths(surface: Surface, points: np.ndarray) -> np.ndarray:
    corners = points[surface.faces]
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)


def _stretch(trunk: TrunkMesh, displacement: np.ndarray) -> float:
    """The largest ratio of lengths, after to before, of edges of the bone surface that join two bones."""
    faces = trunk.bone_faces
    lengths = [_edge_lengths(Surface(p, faces), p) for p in (trunk.nodes, trunk.nodes + displacement)]
    between = trunk.bone[faces] != np.roll(trunk.bone[faces], 1, axis=1)
    return float((lengths[1] / lengths[0])[between].max())


if __name__ == "__main__":
    main(sys.argv[1], *(int(value) for value in sys.argv[2:3]))
