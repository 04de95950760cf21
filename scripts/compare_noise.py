"""The effect of landmark errors: what Cobb angles are read, and where the back turns in whole relaxations.

    python scripts/compare_noise.py ANATOMY --draws 16 --keep FOLDER

Landmarks before and after surgery get errors as two films have them (2.1 +- 1.5 mm). Cobb angles of 60 degrees are
read 40 times, and plans are made from them. Then a thoracic and a double major curve are simulated with every draw
as a patient of its own, and the rotation of the back is compared with that without errors: its offset, and the
deviation that the intervals state over that of the draws.
"""

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from trunks import read_trunk

from warp_trunk import Execution, InputError, RunOptions, SpineCurve, Surface, make_case
from warp_trunk.bone_motion.plan import CurvePlan, Plan, plan_surgery
from warp_trunk.case import Case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.uncertainty import Uncertainty
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.measures import measure
from warp_trunk.measures.rows import as_markdown
from warp_trunk.meshing import MeshOptions
from warp_trunk.preparation.deformity import correct
from warp_trunk.preparation.deformity.published_curves import Kind
from warp_trunk.preparation.landmark_finder import find_landmarks
from warp_trunk.run.intervals import find_bands
from warp_trunk.run.patient import patient_of
from warp_trunk.run.prediction import Prediction, prepare_plan
from warp_trunk.spine.cobb import cobb_angles, coronal_angle, curves_after
from warp_trunk.spine.spine import spine_of

READ = 40
"""How often each angle is read."""
COBB, CORRECTION = 60.0, 0.6
"""Angle that is read [degrees], and the part of it that a plan takes away."""
NONE = 5.0
"""A curve that bends by less than this without errors is invented [degrees]."""
SIMULATED: dict[Kind, tuple[float, float]] = {"thoracic": (60.0, 0.7), "double_major": (85.0, 0.6)}
"""Cobb angle [degrees] and corrected part of the curves that are simulated."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of the comparison."""

    anatomy: tyro.conf.Positional[Path]
    """Folder with skin.ply and bones/."""
    draws: int = 16
    """Relaxations with errors, for each curve; 0 only reads angles."""
    keep: Path = Path("noise")
    """Folder in which each relaxation is kept."""
    tets: int = 80_000
    """Tetrahedra of the mesh."""
    skin_edge: float = 14.0
    """Coarsen the skin to edges of this length [mm] before it is meshed."""
    bone_edge: float = 14.0
    """Edges of the bone surface [mm]."""


def with_errors(landmarks: Landmarks, seed: int) -> Landmarks:
    """Every coordinate with an error of its own."""
    errors = Uncertainty().landmark_sd * np.random.default_rng(seed).standard_normal(landmarks.points.shape)
    return Landmarks(landmarks.names, landmarks.points + errors)


def read_angles(case: Case, kind: Kind) -> list[str]:
    """Angles that are read and planned with errors, as a row of a table."""
    exact = case.landmarks_before
    straight, angles, invented, missed, refused = spine_of(exact), [], 0, [], 0
    for seed in range(READ):
        noisy = with_errors(exact, seed)
        curves = cobb_angles(noisy)
        main = max(curves, key=lambda curve: curve.angle)
        angles.append(main.angle)
        bends = [coronal_angle(straight, curve.upper, curve.lower) or 0.0 for curve in curves]
        invented += min(map(abs, bends)) < NONE
        plan = Plan(uiv="T4", liv="L4", curves=(CurvePlan(main.apex, correction=CORRECTION),))
        try:
            planned = plan_surgery(dataclasses.replace(case, landmarks_before=noisy), plan).landmarks_after
        except InputError:
            refused += 1
            continue
        after = curves_after([main], planned)[0]
        assert after is not None  # every endplate has its landmarks
        missed.append(after - (1.0 - CORRECTION) * main.angle)
    read, off = f"{np.mean(angles):.1f} ± {np.std(angles):.1f}", f"{np.mean(missed):+z.2f} ± {np.std(missed):.2f}"
    return [kind, read, f"{invented} of {READ}", off, str(refused)]


def relaxed(case: Case, options: Options, like: Prediction | None = None) -> Prediction:
    """A case relaxed, on the mesh of another with the same skin and bones where that is given."""
    run = RunOptions(
        mesh=MeshOptions(tets=options.tets, bone_edge_length=options.bone_edge),
        simulation=SimulationOptions(increments=2, relax=RelaxOptions(tolerance=0.3)),
    )
    ready = patient_of(case, run, None if like is None else like.trunk, execution=Execution(cache=False))
    return prepare_plan(ready, case).relax()


def rotations(skin: Surface, landmarks: Landmarks) -> np.ndarray:
    """Rotation of the back by level [degrees]; NaN where missing."""
    return np.array([np.nan if angle is None else angle for angle in measure(skin, landmarks).bsr.values()])


def drawn_rotations(case: Case, kind: Kind, seed: int, exact: Prediction, options: Options) -> np.ndarray:
    """Rotations of the back by level with errors [degrees]; NaN where the relaxation did not converge."""
    path = options.keep / f"{kind}_{seed:02d}.npy"
    if not path.exists():
        before, after = errors_of(case, seed)
        prediction = relaxed(
            dataclasses.replace(case, landmarks_before=before, landmarks_after=after), options, exact
        )
        status = prediction.last.relaxation.status
        angles = rotations(prediction.skin, after)
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, angles if status is RelaxStatus.CONVERGED else np.full_like(angles, np.nan))
        print(kind, seed, status.name, file=sys.stderr, flush=True)
    return np.load(path)


def errors_of(case: Case, seed: int) -> tuple[Landmarks, Landmarks]:
    """The landmarks of a case before and after surgery, with errors."""
    return with_errors(case.landmarks_before, 2 * seed), with_errors(case.planned_landmarks, 2 * seed + 1)


def simulate_draws(case: Case, kind: Kind, options: Options) -> str:
    """Offset and stated deviation of the rotation at every level, as rows of a table.

    The offset is the mean of what a draw has beyond its derivatives, whose mean is zero.
    """
    exact = relaxed(case, options)
    levels = case.landmarks_before.vertebrae()
    effects = find_bands(exact).effects
    rows = [effects.names.tolist().index(["bsr_deg", level]) for level in levels]
    by_landmarks = effects.landmarks[rows]
    stated = effects.ratio[rows] * np.linalg.norm(by_landmarks, axis=1)
    sd, without = Uncertainty().landmark_sd, rotations(exact.skin, case.planned_landmarks)
    drawn, proportional = [], []
    for seed in range(options.draws):
        drawn.append(drawn_rotations(case, kind, seed, exact, options) - without)
        marks = zip(errors_of(case, seed), (case.landmarks_before, case.planned_landmarks), strict=True)
        errors = np.concatenate([noisy.points - points.points for noisy, points in marks])
        proportional.append(by_landmarks @ errors.ravel() / sd)
    values, beyond = np.array(drawn), np.array(drawn) - proportional
    converged = int(np.isfinite(values).all(axis=1).sum())
    deviation, offset = np.nanstd(values, axis=0, ddof=1), np.nanmean(beyond, axis=0)
    error = np.nanstd(beyond, axis=0, ddof=1) / np.sqrt(converged)
    ratio = stated / deviation
    rows = [
        [level, f"{mean:+z.2f} ± {unsure:.2f}", f"{mean / spread:+z.2f}", f"{spread:.2f}", f"{part:.2f}"]
        for level, mean, unsure, spread, part in zip(levels, offset, error, deviation, ratio, strict=True)
    ]
    first = f"{kind}: {converged} of {options.draws} draws converged; ratio {np.median(ratio):.2f} in the median"
    head = ["level", "offset [°]", "over the deviation", "drawn deviation [°]", "stated over drawn"]
    return f"{first}\n\n{as_markdown(head, rows)}"


def main(options: Options) -> None:
    """Prints the tables."""
    skin, bones = read_trunk(options.anatomy)
    straight = find_landmarks(bones).complete()
    kinds: tuple[Kind, ...] = ("thoracic", "thoracolumbar", "double_major")
    rows = []
    for kind in kinds:
        curved = correct(straight, SpineCurve(kind=kind, cobb=COBB, kyphosis=24.0), 0.0)
        rows.append(read_angles(Case(kind, skin, bones, curved), kind))
    head = ["curve of 60°", "read [°]", "draws with an invented curve", "plan missed by [°]", "refused"]
    print(as_markdown(head, rows), flush=True)
    if options.draws:
        skin = coarsen(skin, options.skin_edge, 0.2 * options.skin_edge)
        for kind, (cobb, correction) in SIMULATED.items():
            case = make_case(skin, bones, SpineCurve(kind=kind, cobb=cobb, kyphosis=24.0), correction)
            case = dataclasses.replace(case, uncertainty=Uncertainty())
            print(f"\n{simulate_draws(case, kind, options)}", flush=True)


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
