"""Bones that bend with the spline against bones that move rigidly, measured.

Usage: python scripts/compare_bones.py ANATOMY [TETS]

ANATOMY holds skin.ply and bones/ of a straight trunk, as for make-case. A thoracic curve of 60 degrees is imposed
on it and corrected by 70 %. Prints how the spline changes the shape of each bone. Then simulates three ways: bones
that follow the spline, rigid bones by landmarks and neighbours, and rigid bones known after surgery. The skins are
compared with that of the trunk on which the corrected curve is imposed, by the same rib cage, which bends.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from warp_trunk import (
    MeshOptions,
    SpineCurve,
    Surface,
    bone_motions,
    build_model,
    build_trunk,
    free_joints,
    make_case,
    measure,
    predicted_skin,
    read_surface,
    rigid_path,
    simulate,
    spline_path,
)
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.preparation.deformity import impose
from warp_trunk.preparation.landmark_finder import find_landmarks

CURVE, CORRECTION = SpineCurve(cobb=60.0), 0.7


def main(folder: str, tets: int = 225_000) -> None:
    """Prints both tables for the anatomy in a folder."""
    straight = read_surface(Path(folder) / "skin.ply")
    bones = {path.stem: read_surface(path) for path in sorted((Path(folder) / "bones").glob("*.ply"))}
    case = make_case(straight, bones, CURVE, CORRECTION)
    goal, bones_after, _ = impose(straight, bones, find_landmarks(bones).complete(), CURVE.corrected(CORRECTION))
    landmarks = (case.landmarks_before, case.planned_landmarks)
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
    rigid, known = (bone_motions(case.bones, *landmarks, after) for after in (None, bones_after))
    ways = {
        "spline": (trunk, spline),
        "rigid": (free, rigid_path(free, rigid, spline)),
        "known after": (free, rigid_path(free, known, spline)),
    }
    freed = (trunk.bone >= 0).sum() - (free.bone >= 0).sum()
    print(f"\njoints: {freed} of {(trunk.bone >= 0).sum()} nodes on bone are freed")
    torn = _stretch(trunk, rigid_path(trunk, rigid, spline).displacement)
    print(f"edges between two bones would stretch to {torn:.2f} times their length, were they held")
    wanted = measure(goal, landmarks[1], case.skin)
    print(
        f"largest rotation of the back with the corrected curve imposed: {wanted.max_thoracic_bsr:.2f} degrees\n"
    )
    print(
        "bones        ends       linear iterations   inverted   joints stretch   max BSR   BSR off   skin off [mm]"
    )
    for way, (mesh, path) in ways.items():
        increments = list(simulate(build_model(mesh, case.tissue), path))
        ends = [increment.relaxation for increment in increments]
        skin = predicted_skin(case, mesh, increments[-1].displacement)
        found = measure(skin, landmarks[1], case.skin)
        rotation = [
            abs(here - there)
            for here, there in zip(found.bsr.values(), wanted.bsr.values(), strict=True)
            if here is not None and there is not None
        ]
        off = np.linalg.norm(skin.vertices - goal.vertices, axis=1)
        print(
            f"{way:12} {ends[-1].status.name:10} {sum(end.linear_iterations for end in ends):17d}"
            f" {ends[-1].inverted_tets:10d} {_stretch(trunk, increments[-1].displacement):16.2f}"
            f" {found.max_thoracic_bsr:9.2f}   {np.mean(rotation):.2f} / {np.max(rotation):.2f}"
            f"   {off.mean():.1f} / {off.max():.1f}",
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
