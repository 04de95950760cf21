"""Predictions on several bodies with curves as published, and a drawn cohort beside published means.

    python scripts/compare_bodies.py ANATOMY BODIES > table.md
    python scripts/compare_bodies.py ANATOMY BODIES --imposed-curves
    python scripts/compare_bodies.py ANATOMY BODIES --precision float64
    python scripts/compare_bodies.py ANATOMY BODIES --patients 60 --jobs 8

ANATOMY holds skin.ply and bones/ of a straight trunk, BODIES a folder of such folders. Without `--patients` each
body gets the mean thoracic, thoracolumbar and double major curve and plans of 65 % and 40 %; with it, bodies,
curves and plans are drawn. Every number is measured as `simulate` measures it.
"""

import dataclasses
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from processes import in_processes, threads_of_each
from synthetic_patient import curve_of, draw
from trunks import read_trunk, trunks_in

from warp_trunk import Execution, InputError, RunOptions, SpineCurve, make_case
from warp_trunk.bone_motion.plan import CurvePlan, Plan, plan_surgery
from warp_trunk.bone_motion.rib_cage import ends
from warp_trunk.case import Case
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.measures import TrunkMeasures, measure
from warp_trunk.measures.skin_quality import skin_quality
from warp_trunk.meshing import MeshOptions
from warp_trunk.preparation.deformity.published_curves import Kind
from warp_trunk.run.patient import PreparedPatient, motions_of, patient_of
from warp_trunk.run.prediction import prepare_plan
from warp_trunk.spine.cobb import curves_after, vertebral_tilt
from warp_trunk.spine.spine import spine_of

LEVELS = ("T4", "T5", "T6", "T7", "T8", "T9", "T10", "T11", "T12", "L1", "L2", "L3", "L4")
CURVES: dict[Kind, float] = {"thoracic": 50.0, "thoracolumbar": 50.0, "double_major": 60.0}
FUSED: dict[Kind, tuple[str, str, tuple[str, ...]]] = {
    "thoracic": ("T4", "L1", ("T8",)),
    "thoracolumbar": ("T10", "L3", ("L1",)),
    "double_major": ("T4", "L4", ("T8", "L2")),
}
"""Upper and lower fused vertebra, and the apices of the corrected curves."""
CROSS_SECTION = {
    "T8": (0.065, -0.03),
    "T10": (0.15, 0.04),
    "T12": (0.23, 0.17),
    "L1": (0.20, 0.20),
    "L2": (0.15, 0.20),
    "L3": (0.10, 0.16),
    "L4": (0.07, 0.11),
}
"""Rotation of the back over the Cobb angles of the thoracic and of the lumbar curve, convex right positive, in 30
patients without surgery (PCdare, docs/patients.md)."""
GIVEN_BACK = 0.6
"""The part of the change between such patients that surgery makes: the hump falls by 41 % where the curve falls by
71 % (Mattila et al. 2013)."""
AGREES = 2.5
"""A change of the back that differs by less from that of the cross-section agrees with it [degrees]; the standard
error of the cross-section is about 1.5."""
CORRECTIONS = (0.65, 0.4)
"""Parts of the Cobb angle that plans take away."""
MOST_DRAWS = 100
"""Curves that are drawn for one patient at most, where the trunk cannot take them."""
DEROTATION = 0.4 / 0.65
"""Part of the apical rotation that is taken away, over that of the Cobb angle."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of the comparison."""

    anatomy: tyro.conf.Positional[Path]
    """Folder with skin.ply and bones/."""
    bodies: tyro.conf.Positional[Path]
    """Folder of such folders."""
    patients: int = 0
    """How many patients are drawn; 0 compares the mean curves on each body."""
    seed: int = 1
    """Of all draws."""
    imposed_curves: bool = False
    """Give the bones after surgery: those of the trunk on which the corrected curve is imposed."""
    precision: Literal["float32", "float64"] = "float32"
    """Of the simulation."""
    tets: int = 150_000
    """Tetrahedra of each mesh."""
    increments: int = 4
    """Parts in which a correction is applied."""
    device: str = "auto"
    """Where to compute: auto, cpu, or cuda:0."""
    jobs: int = 1
    """Processes that share the work, each with its part of the cores."""


@dataclass(frozen=True)
class Outcome:
    """The changes by one surgery."""

    before: TrunkMeasures
    after: TrunkMeasures
    status: RelaxStatus
    inverted: int
    cobb: tuple[float, float]
    """Of the largest curve before and after [degrees]."""
    tilt: tuple[float, float]
    """Of T1, positive to the left [degrees]."""
    ribs: tuple[float, float]
    """Rib-vertebra angle difference at the apex, concave less convex [degrees]."""
    apical: tuple[float, float]
    """Axial rotation of the apex [degrees]."""
    left: tuple[float | None, ...]
    """Cobb angle of each curve after surgery between the same vertebrae [degrees]."""
    warned: bool
    """Whether the predicted skin is warned of."""
    released: int
    """Nodes of the tissue that came off the bone."""

    @property
    def side(self) -> float:
        """1 where the largest curve is convex to the right, else -1."""
        return 1.0 if max(self.before.cobb, key=lambda curve: curve.angle).convex == "right" else -1.0

    @property
    def taller(self) -> float:
        """Height of the spine that is gained [mm]."""
        before, after = self.before.spine_height, self.after.spine_height
        return math.nan if before is None or after is None else after.height - before.height

    @property
    def worst(self) -> str:
        """The level at which the back is turned most before."""
        return max(LEVELS, key=lambda level: abs(self.before.bsr.get(level) or 0.0))

    @property
    def hump(self) -> tuple[float, float]:
        """Rotation of the back there, before and after [degrees]."""
        return tuple(abs(state.bsr[self.worst] or math.nan) for state in (self.before, self.after))  # pyright: ignore

    @property
    def hump_over_cobb(self) -> float:
        """The part of the hump that goes, over that of the Cobb angle."""
        (hump, hump_left), (cobb, cobb_left) = self.hump, self.cobb
        return (1.0 - hump_left / hump) / (1.0 - cobb_left / cobb)

    @property
    def off(self) -> dict[str, float]:
        """How much more the back turns to the right by level than the cross-section of patients says [degrees]."""
        lumbar = ("T12", "L1", "L2", "L3", "L4")
        fall = [0.0, 0.0]  # of the largest thoracic and lumbar curve, convex right positive
        for part in (0, 1):
            curves = [c for c in range(len(self.before.cobb)) if (self.before.cobb[c].apex in lumbar) == part]
            if curves:
                largest = max(curves, key=lambda c: self.before.cobb[c].angle)
                curve = self.before.cobb[largest]
                left = self.left[largest]
                fall[part] = ((left or 0.0) - curve.angle) * (1.0 if curve.convex == "right" else -1.0)
        return {
            level: (self.after.bsr[level] or math.nan)
            - (self.before.bsr[level] or math.nan)
            - GIVEN_BACK * (thoracic * fall[0] + lumbar * fall[1])
            for level, (thoracic, lumbar) in CROSS_SECTION.items()
        }


def main(options: Options) -> None:
    """Prints the table."""
    folders = [options.anatomy, *trunks_in(options.bodies)]
    if options.patients:
        _cohort(folders, options)
    else:
        _bodies(folders, options)


def _bodies(folders: list[Path], options: Options) -> None:
    print(
        "| body | curve | plan [%] | hump / Cobb | shoulders [mm] | T12, L1, L2 less expected | freed | inverted |"
    )
    print("|---|---|---|---|---|---|---|---|")
    done: list[Outcome] = []
    tasks: list[tuple[Path, Kind]] = [(folder, kind) for folder in folders for kind in CURVES]
    for (folder, kind), outcomes in zip(tasks, in_processes(_curve, tasks, options, options.jobs), strict=True):
        for correction, o in zip(CORRECTIONS, outcomes, strict=True):
            done.append(o)
            shoulders = [side.difference for m in (o.before, o.after) if (side := m.shoulders)]
            off = ", ".join(f"{o.off[level]:+z.1f}" for level in ("T12", "L1", "L2"))
            off += "" if o.status is RelaxStatus.CONVERGED else f" {o.status.name}"
            print(
                f"| {folder.name} | {kind} {CURVES[kind]:.0f} | {100 * correction:.0f} | {o.hump_over_cobb:.2f} "
                f"| {shoulders[0]:z.0f} to {shoulders[1]:z.0f} | {off} | {o.released} | {o.inverted} |",
                flush=True,
            )
    after = np.array([o.after.shoulders.difference for o in done if o.after.shoulders])
    off = np.array([list(o.off.values()) for o in done])
    differences = ", ".join(
        f"{level} {mean:+z.1f} ± {sd:.1f}"
        for level, mean, sd in zip(CROSS_SECTION, off.mean(axis=0), off.std(axis=0), strict=True)
    )
    print(f"""
- shoulders after: {after.mean():.1f} mm in the mean, {np.abs(after).max():.1f} at most
- change of the back less that of the cross-section of patients: {differences} degrees
- rows within {AGREES} degrees of it at all of these levels: {(np.abs(off) <= AGREES).all(axis=1).sum()}""")
    _print_ends(done, [kind for _, kind in tasks for _ in CORRECTIONS])


def _curve(task: tuple[Path, Kind], options: Options) -> list[Outcome]:
    """The plans for one body with one curve."""
    skin, bones = read_trunk(task[0])
    curve = SpineCurve(kind=task[1], cobb=CURVES[task[1]], kyphosis=24.0)
    patient = patient_of(make_case(skin, bones, curve, 0.65), _run(options), execution=_execution(options))
    return [
        operated(
            patient,
            plan_for(task[1], correction),
            make_case(skin, bones, curve.corrected(correction), 0.0) if options.imposed_curves else None,
        )
        for correction in CORRECTIONS
    ]


def _cohort(folders: list[Path], options: Options) -> None:
    tasks = [(number, folders) for number in range(options.patients)]
    outcomes, kinds, refused = zip(*in_processes(_drawn, tasks, options, options.jobs), strict=True)
    _print_cohort(outcomes)
    _print_ends(outcomes, kinds)
    print(f"- curves that were refused and drawn again: {sum(refused)}")


def _drawn(task: tuple[int, list[Path]], options: Options) -> tuple[Outcome, Kind, int]:
    """One patient, her kind of curve, and how many were refused before her."""
    number, folders = task
    random = np.random.default_rng((options.seed, number))
    for refused in range(MOST_DRAWS):
        skin, bones = read_trunk(folders[random.integers(len(folders))])
        drawn = draw(random, cobb=(45.0, 75.0), truth={}, bending=False)
        try:
            case = make_case(skin, bones, curve_of(drawn), drawn.correction)
            patient = patient_of(case, _run(options), execution=_execution(options))
            return operated(patient, plan_for(drawn.kind, drawn.correction)), drawn.kind, refused
        except InputError as error:
            if not str(error).startswith("curve:"):
                raise
            print(f"drawn again: {error}", file=sys.stderr, flush=True)
    raise SystemExit(f"patient {number}: {MOST_DRAWS} curves were refused")


def _print_ends(outcomes: Sequence[Outcome], kinds: Sequence[Kind]) -> None:
    """How the simulations ended, and how much of the hump went."""
    of_kinds = np.array(kinds)
    numbers = np.array([(*o.hump, o.hump_over_cobb) for o in outcomes])
    for kind in CURVES:
        before, after, part = numbers[of_kinds == kind].T
        if len(part):
            within = sum(abs(part - 0.58) <= 0.1)
            print(
                f"- {kind}: largest rotation {before.mean():.1f} to {after.mean():.1f} degrees, hump over Cobb "
                f"{part.mean():.2f} ± {part.std():.2f}, {within} of {len(part)} in 0.58 ± 0.10"
            )
    released = [o.released for o in outcomes if o.released]
    nodes = f"{min(released)} to {max(released)} nodes" if released else "no node"
    mild = [o.warned for o in outcomes if o.cobb[0] <= 55.0]
    print(f"""- simulations: {len(outcomes)}, converged: {sum(o.status is RelaxStatus.CONVERGED for o in outcomes)}
- with inverted tetrahedra: {sum(o.inverted > 0 for o in outcomes)}
- with tissue released from bone: {len(released)}, at {nodes}
- warned of: {sum(o.warned for o in outcomes)}; of curves up to 55 degrees {sum(mild)} of {len(mild)}""")


def _print_cohort(outcomes: Sequence[Outcome]) -> None:
    """The drawn patients beside published ones; docs/bodies.md has the sources (a) to (h)."""
    rows: dict[str, tuple[list[tuple[float, float]], str]] = {
        "Cobb angle [degrees]": ([o.cobb for o in outcomes], "54.6 ± 9.5 to 14.5 ± 7.5 (a)"),
        "rotation of the back where it is largest [degrees]": (
            [o.hump for o in outcomes],
            "hump 12.3 ± 3.6 to 7.2 ± 3.8, -41 % for Cobb -71 % (b); surface 17.4 to 11.8, -32 % for -76 % (g); "
            "16.1 to 10.3, -36 % for -71 % (h)",
        ),
        "axial rotation of the apex [degrees]": ([o.apical for o in outcomes], "12 to 5 for Cobb 51 to 15 (c)"),
        "shoulder of the convex side higher by [mm]": (list(_to_convex(outcomes)), "7.0 to -1.6 (d)"),
        "tilt of T1 to the convex side [degrees]": (
            [(-o.side * o.tilt[0], -o.side * o.tilt[1]) for o in outcomes],
            "-2.6 ± 6.3 to 3.4 ± 5.5 (a); -0.1 to 2.4 (d)",
        ),
        "rib-vertebra angle difference [degrees]": ([o.ribs for o in outcomes], "-59 % for Cobb -64 % (e)"),
        "height of the spine gained [mm]": ([(0.0, o.taller) for o in outcomes], "about 22 (f)"),
    }
    for level in ("T4", "T6", "T8", "T10", "T12", "L2", "L4"):
        turned = [tuple(o.side * (m.bsr[level] or math.nan) for m in (o.before, o.after)) for o in outcomes]
        rows[f"rotation of the back at {level}, convex side back [degrees]"] = (turned, "")  # pyright: ignore
    print("| measure | before | after | change [%] | published |")
    print("|---|---|---|---|---|")
    for name, (pairs, published) in rows.items():
        values = np.array(pairs)
        mean, deviation = np.nanmean(values, axis=0), np.nanstd(values, axis=0)
        change = f"{100.0 * (mean[1] / mean[0] - 1.0):.0f}" if abs(mean[0]) > 1.0 else ""
        cells = [f"{m:z.1f} ± {d:.1f}" for m, d in zip(mean, deviation, strict=True)]
        print(f"| {name} | {cells[0]} | {cells[1]} | {change} | {published} |")
    print()


def operated(patient: PreparedPatient, plan: Plan, imposed: Case | None = None) -> Outcome:
    """One surgery simulated and measured; the bones after it are those of `imposed`, where that is given."""
    landmarks = patient.case.landmarks_before
    planned = imposed.landmarks_before if imposed else plan_surgery(patient.case, plan).landmarks_after
    bones = dict(imposed.bones) if imposed else patient.case.bones_after
    case = dataclasses.replace(patient.case, landmarks_after=planned, bones_after=bones)
    prediction = prepare_plan(patient, case).relax()
    skin, last = prediction.skin, prediction.last
    before, after = measure(case.skin, landmarks), measure(skin, case.planned_landmarks)
    largest = max(range(len(before.cobb)), key=lambda i: before.cobb[i].angle)
    all_left = tuple(curves_after(before.cobb, case.planned_landmarks))
    left = all_left[largest]
    curve = before.cobb[largest]
    tilts = [float(vertebral_tilt(spine_of(m).endplates)[0]) for m in (landmarks, case.planned_landmarks)]
    apical = [abs(m.axial_rotation[curve.apex] or math.nan) for m in (before, after)]
    return Outcome(
        before,
        after,
        last.relaxation.status,
        last.relaxation.inverted_tets,
        (curve.angle, math.nan if left is None else abs(left)),
        (tilts[0], tilts[1]),
        _rib_vertebra_angles(case, curve.apex, curve.convex),
        (apical[0], apical[1]),
        all_left,
        bool(skin_quality(case.skin, skin, landmarks).faults),
        prediction.released,
    )


def _rib_vertebra_angles(case: Case, apex: str, convex: str) -> tuple[float, float]:
    """Rib-vertebra angle of the concave side less that of the convex one, in the coronal plane [degrees].

    The line of a rib is taken from its head to its outermost point. A vertebra that tilts changes the difference
    by twice its tilt, and no vertebra is quite level: the difference is that where the tilt of the vertebrae
    around the apex is zero. NaN for an apex without ribs.
    """
    around = [f"T{number}" for number in range(int(apex[1:]) - 1, int(apex[1:]) + 2)]
    if not (apex.startswith("T") and set(around) <= {f"T{number}" for number in range(1, 13)}):
        return math.nan, math.nan
    motions = motions_of(case)
    concave = "left" if convex == "right" else "right"
    crossings = []
    for after in (False, True):
        spine = spine_of(case.planned_landmarks if after else case.landmarks_before)
        tilts, differences = [], []
        for level in around:
            axis = np.subtract(*spine.endplates[spine.levels.index(level)])
            tilt, angles = math.degrees(math.atan2(axis[0], axis[2])), {}
            for side, sign in (("left", 1.0), ("right", -1.0)):
                rib = case.bones[name := f"rib_{side}_{int(level[1:]):02d}"]
                widest = rib.vertices[(sign * rib.vertices[:, 0]).argmax()]
                line = np.array([ends(rib, case.bones[level])[0], widest])
                x, _, z = np.subtract(*(motions[name].apply(line) if after else line)[::-1])
                angles[side] = math.degrees(math.atan2(sign * x, -z)) + sign * tilt
            tilts.append(tilt)
            differences.append(angles[concave] - angles[convex])
        crossings.append(float(np.polyfit(tilts, differences, 1)[1]))
    return crossings[0], crossings[1]


def _to_convex(outcomes: Sequence[Outcome]) -> Iterator[tuple[float, float]]:
    for o in outcomes:
        if o.before.shoulders and o.after.shoulders:
            yield o.side * o.before.shoulders.difference, o.side * o.after.shoulders.difference


def plan_for(kind: Kind, correction: float) -> Plan:
    """The plan for a kind of curve that corrects a part of it."""
    upper, lower, apices = FUSED[kind]
    derotation = min(1.0, DEROTATION * correction)
    curves = tuple(CurvePlan(apex=apex, correction=correction, derotation=derotation) for apex in apices)
    return Plan(uiv=upper, liv=lower, curves=curves)


def _run(options: Options) -> RunOptions:
    return RunOptions(
        mesh=MeshOptions(tets=options.tets),
        simulation=SimulationOptions(increments=options.increments),
        precision=options.precision,
    )


def _execution(options: Options) -> Execution:
    return Execution(device=options.device, threads=threads_of_each(options.jobs))


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
