"""Changes by surgery on synthetic bodies beside those of published cohorts.

    python scripts/compare_change.py ANATOMY BODIES > docs/change.md

Curves of the type and size of each cohort are drawn on the bodies, planned as `plan` plans them, and where the
skin counts, simulated. Each change is compared with the published one by two standard errors of the study.
"""

import dataclasses
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from trunks import read_trunk, trunks_in

from warp_trunk import Execution, InputError, RunOptions, SpineCurve, make_case
from warp_trunk.bone_motion.plan import CurvePlan, Plan, plan_surgery
from warp_trunk.case import Case
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.measures import TrunkMeasures, measure
from warp_trunk.measures.measures import measure_spine
from warp_trunk.measures.quantities import MeasureTable
from warp_trunk.meshing import MeshOptions
from warp_trunk.run.patient import patient_of
from warp_trunk.run.prediction import prepare_plan

DEROTATION = 0.4 / 0.65
"""Part of the apical rotation that is taken away, over that of the Cobb angle."""
BEFORE, AFTER = "before", "after"


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of the comparison."""

    anatomy: tyro.conf.Positional[Path]
    """Folder with skin.ply and bones/."""
    bodies: tyro.conf.Positional[Path]
    """Folder of such folders."""
    drawn: int = 20
    """Curves of each kind that are planned."""
    simulated: int = 6
    """How many of the thoracic and of the thoracolumbar ones are simulated."""
    seed: int = 1
    """Of all draws."""
    tets: int = 70_000
    """Tetrahedra of each mesh."""
    skin_edge: float = 12.0
    """Coarsen the skin to edges of this length [mm] before it is meshed; 0 leaves it."""
    bone_edge: float = 12.0
    """Edges of the bone surface [mm]."""
    increments: int = 2
    """Parts in which a correction is applied."""
    threads: int = 0
    """Threads of a simulation; 0 takes all cores."""


@dataclass(frozen=True)
class Group:
    """The curves of a cohort and how they are operated."""

    curve: SpineCurve
    """The mean curve."""
    sd: float
    """Standard deviation of its Cobb angle [degrees]."""
    fused: tuple[str, str]
    """Upper and lower fused vertebra."""
    apex: str
    """That of the curve that is corrected."""
    correction: float
    """The part of its Cobb angle that goes."""


MAIN_THORACIC = Group(SpineCurve(cobb=56.0, kyphosis=24.0), 8.0, ("T4", "L1"), "T8", 0.71)
LUMBAR = Group(
    SpineCurve(kind="thoracolumbar", cobb=48.0, direction="left", kyphosis=24.0), 7.0, ("T10", "L4"), "L1", 0.7
)
BRACED = Group(SpineCurve(cobb=32.0, kyphosis=24.0), 5.0, ("T4", "L1"), "T8", 0.37)
SELECTIVE = {
    name: Group(SpineCurve(cobb=cobb, kyphosis=24.0, lower_share=share), 7.0, ("T4", "T12"), "T8", correction)
    for name, cobb, share, correction in (
        ("1A", 54.0, 0.45, 0.65),
        ("1B", 54.0, 0.58, 0.65),
        ("1C", 59.0, 0.744, 0.636),
    )
}


@dataclass(frozen=True)
class Change:
    """One trunk before and after; of a spine alone the skin is not measured."""

    table: MeasureTable
    """Its numbers in the states before and after."""
    before: TrunkMeasures
    after: TrunkMeasures

    def of(self, quantity: str, level: str | None = None, *, main: bool = False) -> np.ndarray:
        """A number before and after, shape (2,); that of the largest curve where it is one of a curve."""
        if main:
            curve = max(self.before.cobb, key=lambda one: one.angle)
            level = curve.ends if quantity == "cobb_deg" else curve.apex
        place = self.table.place(quantity) if level is None else level
        found = [self.table.value(state, quantity, place or "") for state in (BEFORE, AFTER)]
        return np.array([math.nan if value is None else value for value in found])

    @property
    def lateral(self) -> np.ndarray:
        """Largest distance of the line of spinous processes from that between its ends [mm], (2,)."""
        return np.array([_lateral(measures) for measures in (self.before, self.after)])


def _lateral(measures: TrunkMeasures) -> float:
    """Vertebral centroids, brought back to the spinous processes by their turn of 0.5 degrees for each mm."""
    points = measures.spine.centroids
    way = points[:, 0] - np.interp(points[:, 2], points[[-1, 0], 2], points[[-1, 0], 0])
    turned = np.radians([measures.axial_rotation[level] or 0.0 for level in measures.spine.levels])
    process = way - np.sign(way) * _PROCESS * np.abs(np.sin(turned))
    return float(np.abs(process).max())


_PROCESS = 45.0
"""From the centroid of a vertebra to the skin over its spinous process [mm]."""


def drawn(folders: Sequence[Path], group: Group, count: int, seed: int) -> list[tuple[Case, Plan]]:
    """Cases with curves of a group on the bodies in turn, and their plans."""
    random, found = np.random.default_rng(seed), []
    for number in range(20 * count):
        skin, bones = read_trunk(folders[number % len(folders)])
        cobb = float(random.normal(group.curve.cobb, group.sd))
        curve = dataclasses.replace(group.curve, cobb=cobb)
        try:
            case = make_case(skin, bones, curve, 0.0)
            planned = CurvePlan(group.apex, correction=group.correction, derotation=DEROTATION * group.correction)
            plan = Plan(uiv=group.fused[0], liv=group.fused[1], curves=(planned,))
            plan_surgery(case, plan)
        except InputError as error:
            print(f"drawn again: {error}", file=sys.stderr, flush=True)
            continue
        found.append((case, plan))
        if len(found) == count:
            return found
    raise SystemExit(f"{group.curve}: too many curves were refused")


def planned(cases: Sequence[tuple[Case, Plan]]) -> list[Change]:
    """The spines of cases before and after."""
    found = []
    for case, plan in cases:
        before = measure_spine(case.landmarks_before)
        after = measure_spine(plan_surgery(case, plan).landmarks_after)
        found.append(Change(MeasureTable.of({BEFORE: before, AFTER: after}), before, after))
    return found


def simulated(cases: Sequence[tuple[Case, Plan]], options: Options) -> list[Change]:
    """Cases whose tissue is relaxed, before and after."""
    run = RunOptions(
        mesh=MeshOptions(tets=options.tets, bone_edge_length=options.bone_edge),
        simulation=SimulationOptions(increments=options.increments, relax=RelaxOptions(tolerance=1.0)),
    )
    execution = Execution(threads=options.threads, cache=False)
    found = []
    for case, plan in cases:
        skin = coarsen(case.skin, options.skin_edge, 0.2 * options.skin_edge) if options.skin_edge else case.skin
        patient = patient_of(dataclasses.replace(case, skin=skin), run, execution=execution)
        after = dataclasses.replace(patient.case, landmarks_after=plan_surgery(case, plan).landmarks_after)
        prediction = prepare_plan(patient, after).relax()
        status = prediction.last.relaxation.status
        print(f"simulated: {status.name}, {prediction.last.relaxation.inverted_tets} inverted", file=sys.stderr)
        if status is not RelaxStatus.CONVERGED:
            continue
        states = {BEFORE: measure(skin, case.landmarks_before),
                  AFTER: measure(prediction.skin, after.planned_landmarks)}  # fmt: skip
        found.append(Change(MeasureTable.of(states), *states.values()))
    return found


@dataclass(frozen=True)
class Part:
    """One number of a row."""

    name: str
    published: str
    """Before to after, in words."""
    change: float
    """The published change."""
    error: float
    """Its standard error."""
    values: np.ndarray
    """Predicted before and after of each case, shape (cases, 2), or the change itself, shape (cases,)."""

    @property
    def predicted(self) -> np.ndarray:
        """The change of each case."""
        return self.values if self.values.ndim == 1 else self.values[:, 1] - self.values[:, 0]

    @property
    def within(self) -> bool:
        """Whether the mean change is within two standard errors of the study, or falls where it says no more."""
        mean = float(np.nanmean(self.predicted))
        return mean < 0.0 if math.isnan(self.change) else abs(mean - self.change) <= 2.0 * self.error

    def text(self) -> str:
        """The predicted number."""
        if self.values.ndim == 1:
            return f"{self.name} {np.nanmean(self.values):+z.2g}"
        before, after = np.nanmean(self.values, axis=0)
        judged = "" if math.isnan(self.change) else f"; {self.change:+z.1f} ± {self.error:.1f}"
        return f"{self.name} {before:z.1f} to {after:z.1f} ({after - before:+z.1f}{judged})"


@dataclass(frozen=True)
class Row:
    """A row of the table."""

    curve: str
    n: str
    parts: tuple[Part, ...]
    reason: str
    """How it is compared, and why it is beside."""
    comparable: bool = True
    """Whether both are of the same thing."""

    @property
    def verdict(self) -> str:
        """Whether all numbers are within."""
        within = [part.within for part in self.parts]
        if not self.comparable:
            return "not comparable"
        return "within" if all(within) else f"beside ({sum(within)} of {len(within)} within)"

    def line(self) -> str:
        """The row in Markdown."""
        published = "; ".join(f"{part.name} {part.published}" for part in self.parts)
        predicted = "; ".join(part.text() for part in self.parts)
        return f"| {self.curve} | {self.n} | {published} | {predicted} | {self.verdict} | {self.reason} |"


def stack(changes: Sequence[Change], read: Callable[[Change], np.ndarray]) -> np.ndarray:
    """A number of all changes, shape (cases, 2)."""
    return np.array([read(one) for one in changes])


def correlation(pairs: np.ndarray) -> np.ndarray:
    """The correlation of two columns as the change of a part, shape (1,)."""
    return np.array([np.corrcoef(pairs[np.isfinite(pairs).all(axis=1)].T)[0, 1]])


def main(options: Options) -> None:
    """Prints the page."""
    folders = [folder for folder in trunks_in(options.bodies) if "man_" not in folder.name]
    thoracic = drawn(folders, MAIN_THORACIC, options.drawn, options.seed)
    lumbar = drawn(folders, LUMBAR, options.drawn, options.seed)
    braced = drawn(folders, BRACED, max(1, options.simulated // 2), options.seed)
    selective = {
        name: planned(drawn(folders, one, options.drawn, options.seed)) for name, one in SELECTIVE.items()
    }
    operated, lower, held = (
        simulated(cases[: options.simulated], options) for cases in (thoracic, lumbar, braced)
    )
    unoperated = [measure(case.skin, case.landmarks_before) for case, _ in lumbar]
    imposed = [Change(MeasureTable.of({BEFORE: one, AFTER: one}), one, one) for one in unoperated]
    spines = [*planned(thoracic), *planned(lumbar)]
    rows = rows_of(operated, lower, held, imposed, selective, spines)
    within = sum(row.verdict == "within" for row in rows)
    print(PAGE.format(
        drawn=options.drawn, thoracic=len(operated), lumbar=len(lower), braced=len(held), tets=options.tets,
        increments=options.increments, within=within, rows=len(rows), table="\n".join(row.line() for row in rows),
    ))  # fmt: skip


def rows_of(
    operated: Sequence[Change],
    lower: Sequence[Change],
    held: Sequence[Change],
    imposed: Sequence[Change],
    selective: dict[str, list[Change]],
    spines: Sequence[Change],
) -> list[Row]:
    """The ten rows; sizes are those on the patient's side of the curve."""

    def apical(change: Change) -> float:
        return abs(float(change.of("apical_translation_mm", main=True)[0]))

    def lumbar_part(changes: Sequence[Change]) -> np.ndarray:
        parts = []
        for one in changes:
            curve = next(c for c in one.before.cobb if c.apex in ("T12", "L1", "L2", "L3", "L4"))
            angle = one.of("cobb_deg", curve.ends)
            parts.append(100.0 * (angle[1] / angle[0] - 1.0))
        return np.array(parts)

    def lumbar_turn(changes: Sequence[Change]) -> np.ndarray:
        apices = [next(c.apex for c in one.before.cobb if c.apex[0] == "L") for one in changes]
        return np.array([
            np.abs(one.of("axial_rotation_deg", apex)) for one, apex in zip(changes, apices, strict=True)
        ])  # fmt: skip

    ratios = {
        "waist angle ratio": ("waist_angle_ratio_percent", "87.3 to 97.7 %", 10.4, 1.2, -0.40, 0.13),
        "waist height angle": ("waist_height_angle_deg", "-2.0 to 1.4°", 3.4, 0.5, -0.44, 0.13),
        "waistline depth ratio": ("waistline_depth_ratio_percent", "32.1 to 89.9 %", 57.8, 6.2, -0.69, 0.08),
    }
    return [
        Row("thoracic, derotated or not", "72", (
            Part("Cobb", "56 to 16°", -40.0, 1.5, np.abs(stack(operated, lambda c: c.of("cobb_deg", main=True)))),
            Part("hump", "14.2 ± 5.0 to 8.3 ± 3.7 and 12.3 to 7.2°", -5.6, 0.5,
                 np.abs(stack(operated, lambda c: c.of("main_atr_deg")))),
        ), "standing slope; the hump was measured in the forward bend [1]"),
        Row("Lenke 5C/6C", "42", tuple(
            Part(name, words, change, error, stack(lower, lambda c, key=key: c.of(key)))
            for name, (key, words, change, error, _, _) in ratios.items()
        ), "standard deviations of 8 %, 3° and 40 % are assumed [2]"),
        Row("the same, correlation with apical translation", "42", tuple(
            Part(f"r of {name}", f"{r:+.2f}", r, error,
                 correlation(np.array([[c.of(key)[0], apical(c)] for c in imposed])))
            for name, (key, _, _, _, r, error) in ratios.items()
        ), "before surgery; curves that differ in size alone tie translation to it [2]"),
        Row("1A / 1B / 1C, fused to T12", "20", (
            *(Part(f"lumbar Cobb {name}", f"{change:.0f} %", change, 10.0, lumbar_part(selective[name]))
              for name, change in (("1A", -54.0), ("1B", -41.0), ("1C", -21.0))),
            Part("lumbar apex rotation", "unchanged", 0.0, 1.0, lumbar_turn(selective["1B"])),
        ), "the default plan lets half of every unfused curve go; a standard deviation of 26 % is assumed [3]"),
        Row("1C/2C", "24", (
            Part("thoracic", "59.0 to 21.5°", -37.5, 2.0,
                 stack(selective["1C"], lambda c: c.of("cobb_deg", main=True))),
            Part("lumbar", "43.9 to 22.0°, -50 %", -50.0, 5.0, lumbar_part(selective["1C"])),
            Part("balance", "-5.6 to -14.6 mm", -9.0, 3.0,
                 stack(selective["1C"], lambda c: c.of("trunk_shift_mm"))),
        ), "the default plan keeps balance [4]"),
        Row("mixed", "23", (
            Part("trunk length", "401 ± 32 to 422 ± 26 mm", 21.0, 4.0,
                 stack(spines, lambda c: c.of("trunk_length_mm"))),
        ), "the standard deviation of the change is taken as 19 mm [5]"),
        Row("thoracic and thoracolumbar", "24", (
            Part("lateral deviation", "37.3 to 20.4 mm", -16.9, 2.5,
                 stack([*operated, *lower], lambda c: c.lateral)),
        ), "of the spinous processes from the line between their ends; a deviation of 12 mm is assumed [6]"),
        Row("main thoracic / thoracolumbar", "146 / 26", (
            *(Part(f"{name}, {kind}", words, change, 2.0, np.abs(stack(changes, lambda c, key=key: c.of(key))))
              for kind, changes, words, change in (
                  ("thoracic", operated, "falls", math.nan), ("thoracolumbar", lower, "not clearly", 0.0))
              for name, key in (("shoulders", "shoulder_difference_mm"), ("waist depth", "waist_depth_mm"))),
        ), "the abstract says whether they fall; 10 mm is the assumed standard deviation where they do not [7]"),
        Row("any", "619", (
            Part("shoulders", "7.0 to -1.6 mm", -8.6, 0.5,
                 stack(operated, lambda c: c.of("shoulder_difference_mm"))),
        ), "radiographic, all types; a standard deviation of 12 mm is assumed [8]"),
        Row("in brace", "89", (
            Part("Cobb", "-37 %", -37.0, 2.0, np.array([
                100.0 * (np.divide(*c.of("cobb_deg", main=True)[::-1]) - 1.0) for c in held])),
            Part("shoulders", "unchanged", 0.0, 1.5, stack(held, lambda c: c.of("shoulder_difference_mm"))),
        ), "the bones move as a plan moves them, but a brace presses on the skin [9]", comparable=False),
    ]  # fmt: skip


PAGE = """# Published and predicted change

No pair of scans before and after surgery is public. The nearest to truth is what cohorts changed, beside what
the default plan and simulation change on bodies of girls and a woman with curves of that type and size. {drawn}
curves of each kind were planned. {thoracic} thoracic, {lumbar} thoracolumbar and {braced} braced ones were
simulated ({tets:,} tetrahedra, {increments} increments, tolerance 1 mm); all of these ended CONVERGED. A row is
within where every number is within two standard errors of the study. **{within} of {rows} rows are within.**
Brackets hold the predicted change, and the published one ± its standard error, assumed where the abstract has
none. Nothing is tuned to this. Verdicts on fewer than six simulated curves of a kind are no finding.

```
python scripts/compare_change.py ANATOMY BODIES > docs/change.md
```

| curve | n | published | predicted | verdict | how it is compared |
|---|---|---|---|---|---|
{table}

Sources: [1] Mattila 2013, Spine. [2] Spine Deform 2024, PMID 38526692. [3] doi 10.1007/s00590-026-04696-z.
[4] Ishikawa, J Orthop Sci 2015, 20:31. [5] Lonner 2020. [6] doi 10.3233/978-1-60750-903-5-258.
[7] doi 10.1186/s13013-017-0140-0. [8] 619 patients, radiographic assessment of shoulder position. [9] Abstract
of 89 patients in brace."""


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
