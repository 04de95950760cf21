"""How ribs go after surgery, three ways, on virtual patients, against what the clinic published.

Usage: python scripts/compare_ribs.py ANATOMY [TETS]

ANATOMY holds skin.ply and bones/ of a straight trunk, as for make-case. Curves are imposed on it and parts of them
corrected. Each plan is simulated with bones that the spline carries, with ribs that follow by shares, and with all
bones known after surgery (those of the trunk on which the corrected curve is imposed, each rigidly). Printed: the
change of back surface rotation (BSR), at the level where it was largest, over that of the Cobb angle (0.58 for the
hump in Mattila et al. 2013), the largest left anywhere, what 5 degrees less of derotation at the same Cobb angle
change, how smooth the skin stays, and the work. docs/ribs.md holds the table.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from warp_trunk import (
    Case,
    MeshOptions,
    SpineCurve,
    Surface,
    build_trunk,
    make_case,
    measure,
    predicted_skin,
    read_surface,
    simulate,
)
from warp_trunk.engine.simulation import Increment, SimulationOptions
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.measures.skin_quality import skin_quality
from warp_trunk.preparation.deformity import correct, impose
from warp_trunk.preparation.landmark_finder import find_landmarks
from warp_trunk.run.options import RunOptions
from warp_trunk.run.prepare import prepare

PATIENTS = (
    *(SpineCurve(cobb=cobb) for cobb in (45.0, 60.0, 75.0)),
    SpineCurve(kind="thoracolumbar"),
    SpineCurve(kind="double_major"),
)
CORRECTIONS = (0.5, 0.6, 0.7, 0.8)
LESS = 5.0
"""Degrees of derotation left out, at the same Cobb angle."""
LEVELS = (*(f"T{number}" for number in range(5, 13)), "L1", "L2", "L3")
"""Where a hump is looked for: above T5 the section crosses the shoulders, below L3 the pelvis."""


def main(folder: str, tets: int = 130_000) -> None:
    """Prints a row for each patient, correction and way."""
    skin = read_surface(Path(folder) / "skin.ply")
    bones = {path.stem: read_surface(path) for path in sorted((Path(folder) / "bones").glob("*.ply"))}
    straight = find_landmarks(bones).complete()
    print("patient           corrected   way      BSR there   over Cobb   largest anywhere   with less derotation"
          "   skin edges   fold   iterations   inverted   ends")  # fmt: skip
    for curve in PATIENTS:
        case = make_case(skin, bones, curve, 0.7)
        trunk = build_trunk(case.skin, case.bones, MeshOptions(tets=tets))
        for fraction in CORRECTIONS:
            left = curve.corrected(fraction)
            plan = replace(case, landmarks_after=correct(straight, left, 0.0))
            less = replace(left, apical_rotation=left.rotation + LESS)
            turned = replace(case, landmarks_after=correct(straight, less, 0.0))
            known = replace(plan, bones_after=_known(case, impose(skin, bones, straight, left)[1]))
            for way, one, other in (("spline", plan, turned), ("follow", plan, turned), ("known", known, None)):
                _print_row(f"{curve.kind} {curve.cobb:g}", fraction, way, (one, other), trunk)


def _known(case: Case, after: dict[str, Surface]) -> dict[str, Surface]:
    """The bones after, each moved rigidly."""
    return {
        name: Surface(fit_rigid(bone.vertices, after[name].vertices).apply(bone.vertices), bone.faces)
        for name, bone in case.bones.items()
    }


def _print_row(patient: str, fraction: float, way: str, plans: tuple[Case, Case | None], trunk: TrunkMesh) -> None:
    case, turned = plans
    increments, skin = _simulated(case, trunk, way)
    before = _rotations(case.skin, case, after=False)
    after = _rotations(skin, case)
    apex = int(np.abs(before).argmax())
    ratio = (1.0 - abs(after[apex] / before[apex])) / fraction
    less = (
        "-"
        if turned is None
        else f"{abs(_rotations(_simulated(turned, trunk, way)[1], turned) - after)[apex]:.1f}"
    )
    quality = skin_quality(case.skin, skin, case.landmarks_before)
    end, work = increments[-1].relaxation, sum(one.relaxation.linear_iterations for one in increments)
    print(
        f"{patient:18}{fraction:9.1f}   {way:8} {abs(before[apex]):4.1f} {abs(after[apex]):5.1f} {ratio:12.2f}"
        f"{np.abs(after).max():>18.1f}"
        f"{less:>23} {quality.least_stretch:7.2f} {quality.most_stretch:5.2f} {quality.fold:6.0f}"
        f" {work:12d} {end.inverted_tets:10d}   {end.status.name}",
        flush=True,
    )


def _simulated(case: Case, trunk: TrunkMesh, way: str) -> tuple[list[Increment], Surface]:
    ready = prepare(case, RunOptions(bones="spline" if way == "spline" else "follow"), trunk)
    increments = list(simulate(ready.model, ready.bone_path, SimulationOptions(increments=5)))
    return increments, predicted_skin(case, ready.trunk, increments[-1].displacement)


def _rotations(skin: Surface, case: Case, *, after: bool = True) -> np.ndarray:
    found = measure(skin, case.planned_landmarks if after else case.landmarks_before).bsr
    return np.array([np.nan_to_num(found[level] or 0.0) for level in LEVELS])


if __name__ == "__main__":
    main(sys.argv[1], *(int(value) for value in sys.argv[2:3]))
