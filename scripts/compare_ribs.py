"""How ribs go after surgery, three ways, on virtual patients, against what the clinic published.

    python scripts/compare_ribs.py ANATOMY

ANATOMY holds skin.ply and bones/ of a straight trunk, as for make-case. Curves are imposed on it and parts of them
corrected. Each plan is simulated with bones that the spline carries, with ribs that follow by shares, and with all
bones known after surgery (those of the trunk on which the corrected curve is imposed, each rigidly). Prints the
tables of docs/ribs.md: the change of back surface rotation (BSR) at the level where it was largest, over that of
the Cobb angle (0.58 for the hump in Mattila et al. 2013), what 5 degrees less of derotation at the same Cobb angle
change, how smooth the skin stays, the work, and how each bar is met in all plans. Rows are kept in a folder, so
that it goes on where it was stopped, and several processes can share the work; delete the folder when a model has
changed.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np
from benchmarking.process import be_quiet
from benchmarking.tables import markdown

from warp_trunk import (
    Case,
    Landmarks,
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
from warp_trunk.case.rib_shares import RibShares
from warp_trunk.engine.simulation import Increment, SimulationOptions
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.geometry.rigid import fit_rigid
from warp_trunk.measures.skin_quality import skin_change
from warp_trunk.preparation.deformity import correct, impose
from warp_trunk.preparation.landmark_finder import find_landmarks
from warp_trunk.run.options import RunOptions
from warp_trunk.run.prepare import prepare

Way = Literal["spline", "follow", "known"]
PATIENTS = (
    *(SpineCurve(cobb=cobb) for cobb in (45.0, 60.0, 75.0)),
    SpineCurve(kind="thoracolumbar"),
    SpineCurve(kind="double_major"),
)
CORRECTIONS = (0.5, 0.6, 0.7, 0.8)
SHOWN = 0.7
"""The correction at which less derotation, known bones, skin and work are told."""
WAYS: tuple[Way, ...] = ("spline", "follow", "known")
LESS = 5.0
"""Degrees of derotation left out, at the same Cobb angle."""
LEVELS = (*(f"T{number}" for number in range(1, 13)), "L1", "L2", "L3", "L4")
HUMP = slice(LEVELS.index("T5"), LEVELS.index("L3") + 1)
"""Where a hump is looked for: above T5 the section crosses the shoulders, below L3 the pelvis."""


@dataclass(frozen=True)
class Row:
    """A plan for a virtual patient, simulated one way."""

    patient: str
    """Kind and Cobb angle of the curve."""
    correction: float
    """The part of it that surgery takes away."""
    way: str
    """How its bones are moved."""
    derotation: float
    """Of the apical vertebra [degrees]."""
    before: list[float]
    """BSR by level [degrees]."""
    after: list[float]
    """The same after."""
    less: list[float] | None
    """The same with less derotation at the same Cobb angle; None where that was not simulated."""
    edges: tuple[float, float]
    """The least and the most length of an edge of the skin, over that before."""
    fold: float
    """By how much more any edge of the skin is folded [degrees]."""
    most_edges: tuple[float, float]
    """The lengths between which all edges are but a thousandth at either end."""
    most_fold: float
    """The fold that a thousandth of the edges passes [degrees]."""
    iterations: int
    """Linear iterations of all increments."""
    inverted: int
    """Tetrahedra without positive volume."""
    status: str
    """Why the last relaxation ended."""

    @property
    def apex(self) -> int:
        """The level where BSR was largest."""
        return int(np.abs(self.before[HUMP]).argmax()) + HUMP.start

    @property
    def change(self) -> np.ndarray:
        """Of BSR by level [degrees]."""
        return np.subtract(self.after, self.before)

    @property
    def over_cobb(self) -> float:
        """The part of the hump that is gone, over that of the Cobb angle."""
        return (1.0 - abs(self.after[self.apex] / self.before[self.apex])) / self.correction

    @property
    def of_less(self) -> float:
        """What less derotation changes at the apex [degrees]; NaN where that was not simulated."""
        return float("nan") if self.less is None else abs(self.less[self.apex] - self.after[self.apex])

    @property
    def ends_quiet(self) -> bool:
        """Whether no level above T3 or below L2 changes by more than any from T3 to L2."""
        change = np.abs(self.change)
        middle = slice(LEVELS.index("T3"), LEVELS.index("L2") + 1)
        return bool(max(change[: middle.start].max(), change[middle.stop :].max()) <= change[middle].max())

    @property
    def smooth(self) -> bool:
        """Whether the skin meets its bars."""
        return self.edges[0] >= 0.85 and self.edges[1] <= 1.2 and self.fold <= 10.0


class Study:
    """The virtual patients on one anatomy."""

    def __init__(self, folder: Path, tets: int, shares: RibShares) -> None:
        self.skin = read_surface(folder / "skin.ply")
        self.bones = {path.stem: read_surface(path) for path in sorted((folder / "bones").glob("*.ply"))}
        self.tets, self.shares = tets, shares
        self.straight: Landmarks = find_landmarks(self.bones).complete()
        self.patient = cache(self._patient)

    def _patient(self, curve: SpineCurve) -> tuple[Case, TrunkMesh]:
        case = replace(make_case(self.skin, self.bones, curve, SHOWN), rib_shares=self.shares)
        return case, build_trunk(case.skin, case.bones, MeshOptions(tets=self.tets))

    def row(self, curve: SpineCurve, correction: float, way: Way) -> Row:
        """Simulates a plan one way."""
        case, trunk = self.patient(curve)
        left = curve.corrected(correction)
        plan = replace(case, landmarks_after=correct(self.straight, left, 0.0))
        less = None
        if way == "known":
            plan = replace(plan, bones_after=_known(case, impose(self.skin, self.bones, self.straight, left)[1]))
        elif correction == SHOWN:
            turned = replace(left, apical_rotation=left.rotation + LESS)
            other = replace(case, landmarks_after=correct(self.straight, turned, 0.0))
            less = _rotations(_simulated(other, trunk, way)[1], other.planned_landmarks)
        increments, skin = _simulated(plan, trunk, way)
        quality, end = skin_change(case.skin, skin), increments[-1].relaxation
        low, high = np.quantile(quality.stretch, [0.001, 0.999])
        return Row(
            patient=f"{curve.kind.replace('_', ' ')} {curve.cobb:g}",
            correction=correction,
            way=way,
            derotation=curve.rotation - left.rotation,
            before=_rotations(case.skin, case.landmarks_before),
            after=_rotations(skin, plan.planned_landmarks),
            less=less,
            edges=(float(quality.stretch.min()), float(quality.stretch.max())),
            fold=float(quality.fold.max()),
            most_edges=(float(low), float(high)),
            most_fold=float(np.quantile(quality.fold, 0.999)),
            iterations=sum(one.relaxation.linear_iterations for one in increments),
            inverted=end.inverted_tets,
            status=end.status.name,
        )


def main() -> None:
    """Simulates what is not kept yet, and prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("anatomy", type=Path)
    parser.add_argument("--tets", type=int, default=130_000)
    parser.add_argument("--shares", default="{}", help='other shares of the ribs, such as {"recovery": 0.8}')
    parser.add_argument("--kept", type=Path, default=Path("results/ribs"), help="where rows are kept")
    parser.add_argument("--part", default="0/1", help="which part of the rows this process makes: 0/4 to 3/4")
    given = parser.parse_args()
    be_quiet()
    shares = json.loads(given.shares)
    study = Study(given.anatomy, given.tets, RibShares(**shares))
    number, parts = map(int, given.part.split("/"))
    plans = [plan for plan in product(PATIENTS, CORRECTIONS, WAYS) if plan[2] != "known" or plan[1] == SHOWN]
    given.kept.mkdir(parents=True, exist_ok=True)
    rows = []
    for curve, correction, way in plans[number::parts]:
        changed = "" if way == "spline" else "".join(f"_{name}{value:g}" for name, value in shares.items())
        path = given.kept / f"{curve.kind}{curve.cobb:g}_{correction:g}_{way}{changed}_{given.tets}.json"
        if not path.is_file():
            making = path.with_suffix(f".{os.getpid()}")
            making.write_text(json.dumps(asdict(study.row(curve, correction, way))))
            os.replace(making, path)
        rows.append(Row(**json.loads(path.read_text())))
        print(f"{path.stem}: {rows[-1].status}, {rows[-1].over_cobb:.2f}", flush=True)
    if parts == 1:
        print(f"\n{by_patient(rows)}\n{by_bar(rows)}")


def by_patient(rows: list[Row]) -> str:
    """A line for each patient and way, as Markdown."""
    lines = []
    for patient, way in dict.fromkeys((row.patient, row.way) for row in rows):
        all_ = [row for row in rows if (row.patient, row.way) == (patient, way)]
        row = next(row for row in all_ if row.correction == SHOWN)
        change = row.change
        ratios = {one.correction: f"{one.over_cobb:.2f}" for one in all_}
        lines.append(
            [
                patient,
                way,
                f"{LEVELS[row.apex]}, {abs(row.before[row.apex]):.1f}",
                ", ".join(ratios.get(correction, "-") for correction in CORRECTIONS),
                f"{abs(change[row.apex]) / row.derotation:.2f}",
                "-" if row.less is None else f"{row.of_less:.1f}",
                "; ".join(f"{change[LEVELS.index(level)]:+.1f}" for level in ("T1", "L3")),
                f"{row.edges[0]:.2f} to {row.edges[1]:.2f} ({row.most_edges[0]:.2f} to {row.most_edges[1]:.2f})",
                f"{row.fold:.0f} ({row.most_fold:.0f})",
                str(row.iterations),
                str(row.inverted),
                row.status,
            ]
        )
    over = f"change of BSR over that of Cobb at {', '.join(f'{correction:g}' for correction in CORRECTIONS)}"
    names = [
        "curve",
        "way",
        "apex, BSR before",
        over,
        "for each degree of derotation",
        "5 degrees less derotation",
    ]
    at = f"T1; L3 at {SHOWN:g}"
    return markdown(
        [*names, at, f"skin edges at {SHOWN:g}", "fold", "iterations", "inverted", "ends"],
        lines,
    )


def by_bar(rows: list[Row]) -> str:
    """How each bar is met by all plans, as Markdown."""
    found: dict[str, list[str]] = {}
    for way in ("spline", "follow"):
        own = [row for row in rows if row.way == way]
        ratios = np.array([row.over_cobb for row in own])
        less = [row.of_less for row in own if row.less is not None]
        slopes = [abs(row.change[row.apex]) / row.derotation for row in own]
        thoracic = next(row for row in own if row.patient == "thoracic 60" and row.correction == SHOWN)
        left = np.abs(thoracic.after[LEVELS.index("T7") : LEVELS.index("T10") + 1])
        cells = {
            "change of the hump over that of Cobb 0.58 ± 0.08": f"{ratios.mean():.2f} in the mean, "
            f"{int((np.abs(ratios - 0.58) <= 0.08).sum())} of {len(own)} plans within",
            "5 degrees less of derotation change BSR by at most 1.5": f"{min(less):.1f} to {max(less):.1f}",
            "BSR for each degree of derotation 0.3 to 0.6": f"{min(slopes):.2f} to {max(slopes):.2f}",
            "residual BSR 4 to 12 degrees, T7 to T10 (60 degrees, 0.7)": f"{left.min():.1f} to {left.max():.1f}",
            "no level above T3 or below L2 changes most": f"{sum(row.ends_quiet for row in own)} of {len(own)}",
            "edges of skin 0.85 to 1.2, folds to 10 degrees": f"{min(row.edges[0] for row in own):.2f} to "
            f"{max(row.edges[1] for row in own):.2f}; {min(row.fold for row in own):.0f} to "
            f"{max(row.fold for row in own):.0f}; {sum(row.smooth for row in own)} of {len(own)}",
            "plans with inverted tetrahedra, the most of them": f"{sum(row.inverted > 0 for row in own)}, "
            f"{max(row.inverted for row in own)}",
            "linear iterations, median": f"{np.median([row.iterations for row in own]):.0f}",
            "relaxations that converged": f"{sum(row.status == 'CONVERGED' for row in own)} of {len(own)}",
        }
        for name, cell in cells.items():
            found.setdefault(name, []).append(cell)
    return markdown(["bar", "spline", "follow"], [[name, *cells] for name, cells in found.items()])


def _known(case: Case, after: dict[str, Surface]) -> dict[str, Surface]:
    """The bones after, each moved rigidly."""
    return {
        name: Surface(fit_rigid(bone.vertices, after[name].vertices).apply(bone.vertices), bone.faces)
        for name, bone in case.bones.items()
    }


def _simulated(case: Case, trunk: TrunkMesh, way: Way) -> tuple[list[Increment], Surface]:
    ready = prepare(case, RunOptions(bones="spline" if way == "spline" else "follow"), trunk)
    increments = list(simulate(ready.model, ready.bone_path, SimulationOptions(increments=5)))
    return increments, predicted_skin(case, ready.trunk, increments[-1].displacement)


def _rotations(skin: Surface, landmarks: Landmarks) -> list[float]:
    found = measure(skin, landmarks).bsr
    return [float(np.nan_to_num(found[level] or 0.0)) for level in LEVELS]


if __name__ == "__main__":
    main()
