"""Verifies the program and writes docs/verification.md: equilibria, intervals, landmarks, import, plans, ribs.

    PYTHONPATH=tests uv run python scripts/verify.py ANATOMY BODIES            # under an hour on two cores
    PYTHONPATH=tests uv run python scripts/verify.py ANATOMY BODIES --quick    # about five minutes, smaller meshes

The independent solver is tests/support/finite_elements.py. ANATOMY holds skin.ply and bones/ of a
straight trunk, BODIES a folder of such folders.
"""

import dataclasses
import io
import itertools
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from compare_bodies import CURVES, operated, plan_for
from trunks import read_trunk, trunks_in

from support.finite_elements import Solid, equilibrium
from warp_trunk.bone_motion.plan import plan_surgery
from warp_trunk.case import Case, read_case, write_case
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.uncertainty import FACTORS, Uncertainty
from warp_trunk.cli import main as command
from warp_trunk.engine.relaxation import RelaxOptions, RelaxStatus
from warp_trunk.engine.simulation import Increment, SimulationOptions
from warp_trunk.geometry.coarsening import coarsen
from warp_trunk.geometry.surface import Surface
from warp_trunk.measures import compare_skins, measure
from warp_trunk.meshing import MeshOptions, predicted_skin
from warp_trunk.preparation.deformity import SpineCurve, make_case
from warp_trunk.preparation.landmark_finder import find_landmarks
from warp_trunk.run.intervals import find_bands
from warp_trunk.run.options import RunOptions
from warp_trunk.run.patient import PreparedPatient, patient_of
from warp_trunk.run.prediction import prepare_plan
from warp_trunk.spine import curves_after

ROOT = Path(__file__).parents[1]
Trunk = tuple[Surface, dict[str, Surface]]
"""Skin and bones by name."""
CORRECTION = 0.65
COARSE = MeshOptions(tets=45_000, bone_voxel=8.0, bone_tolerance=2.0)
"""The mesh of a quick run, with a coarser bone surface."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Data of the verification."""

    anatomy: tyro.conf.Positional[Path]
    """Folder with skin.ply and bones/."""
    bodies: tyro.conf.Positional[Path]
    """Folder of such folders."""
    quick: bool = False
    """Smaller meshes, fewer draws, one body."""
    out: Path = ROOT / "docs" / "verification.md"
    """The page."""

    def either(self, quick: int, full: int) -> int:
        """The number for a quick run or a full one."""
        return quick if self.quick else full


def main(options: Options) -> None:
    """Runs every section and writes the page."""
    skin, bones = read_trunk(options.anatomy)
    trunk = coarsen(skin, 16.0, 3.0) if options.quick else skin, bones
    how = "on smaller meshes (`--quick`)" if options.quick else "in full"
    page = [
        "# Verification",
        f"This page is written by `scripts/verify.py`, run {how}. The anatomy is an adult man "
        "([anatomy](anatomy.md)); the curves are imposed by `make-case`. No number on this page compares "
        "a prediction with a patient.",
    ]
    for section in (equilibria, intervals, landmarks, import_, plans, ribs):
        print(section.__name__, file=sys.stderr, flush=True)
        page += ["\n".join(section(trunk, options))]
        options.out.write_text("\n\n".join(page) + "\n", encoding="utf-8", newline="\n")


def equilibria(trunk: Trunk, options: Options) -> Iterator[str]:
    """Distance of equilibria from those of an independent solver, and of the default from its own in float64."""
    yield "## Equilibrium of the tissue\n"
    yield (
        "The largest distance of any node from the true equilibrium, reported and true. The reference is "
        "scikit-fem with an energy that was written independently, without the resistance of the skin to bending; "
        "with it, the program itself in float64.\n"
    )
    yield "| scene | precision | reference | reported [mm] | true [mm] |"
    yield "|---|---|---|---:|---:|"
    case = imposed(trunk, "thoracic")
    tets = options.either(COARSE.tets, 80_000)
    for ratio in (0.3, 0.45, 0.49):
        soft = dataclasses.replace(case, tissue=dataclasses.replace(case.tissue, poisson_ratio=ratio))
        patient = ready(soft, tets, skin_rigidity=0.0)
        solid = Solid(patient.trunk.nodes, patient.trunk.tets, 1e-3 * soft.tissue.youngs_modulus, ratio)
        last = relaxed(patient, soft)
        true = equilibrium(solid, last.displacement, patient.trunk.prescribed, tolerance=1e-6)
        yield row(f"Poisson's ratio {ratio}", "float32", "scikit-fem", *reported_and_true(last, true))
    rough = relaxed(ready(case, tets), case)
    fine = relaxed(ready(case, tets, precision="float64", tolerance=1e-5), case)
    yield row("default", "float32", "float64", *reported_and_true(rough, fine.displacement))


def intervals(trunk: Trunk, options: Options) -> Iterator[str]:
    """Standard deviations by derivatives against those of whole simulations with drawn landmark errors."""
    certain = {name: 1.0 if name in FACTORS else 0.0 for name in vars(Uncertainty())}
    errors = Uncertainty(**{**certain, "landmark_error": 2.1, "landmark_error_sd": 1.5})
    case = dataclasses.replace(imposed(trunk, "thoracic"), uncertainty=errors)
    patient = ready(case, options.either(COARSE.tets, 145_000), increments=2)
    bands = find_bands(prepare_plan(patient, case).relax()).table.column("predicted", "bsr_deg")
    random, draws = np.random.default_rng(1), options.either(12, 60)
    values: dict[str, list[float]] = {level: [] for level in bands}
    for _ in range(draws):
        before, after = (
            noisy(marks, errors.landmark_sd, random) for marks in (case.landmarks_before, case.planned_landmarks)
        )
        drawn = dataclasses.replace(case, landmarks_before=before, landmarks_after=after)
        skin = predicted_skin(drawn, patient.trunk, relaxed(patient, drawn).displacement)
        for level, angle in measure(skin, after, case.skin).bsr.items():
            if level in values and angle is not None:
                values[level].append(angle)
    ratios = {level: bands[level].sd / np.std(draws_at, ddof=1) for level, draws_at in values.items()}
    inside = [bool(bands[level].holds(value)) for level, draws_at in values.items() for value in draws_at]
    yield "## 95 % intervals\n"
    yield (
        f"{draws} whole simulations with random errors of all landmarks (2.1 ± 1.5 mm) against `--bands` with "
        "this source of error alone: standard deviation of the rotation by derivatives over that of the "
        "simulations.\n"
    )
    yield "| levels | ratio, mean | smallest | largest | simulations within the interval |"
    yield "|---:|---:|---:|---:|---:|"
    all_ratios = np.array(list(ratios.values()))
    yield row(
        len(all_ratios),
        *(f"{x:.2f}" for x in (all_ratios.mean(), all_ratios.min(), all_ratios.max())),
        f"{100 * np.mean(inside):.0f} %",
    )


def landmarks(trunk: Trunk, options: Options) -> Iterator[str]:
    """Landmarks found on curved spines against those that moved with the bones."""
    yield "## Landmarks found on bones\n"
    yield (
        "Landmarks that moved with the bones as a curve was imposed, and those that `landmarks` finds on curved "
        "bones.\n"
    )
    yield "| curve | distance, mean [mm] | largest [mm] | Cobb angle found [°] | true [°] |"
    yield "|---|---:|---:|---:|---:|"
    for kind in CURVES:
        case = imposed(trunk, kind)
        marks_found = find_landmarks(case.bones).complete()
        distance = np.linalg.norm(marks_found.points - case.landmarks_before.points, axis=1)
        angles = [
            f"{max(curve.angle for curve in measure(case.skin, marks).cobb):.1f}"
            for marks in (marks_found, case.landmarks_before)
        ]
        yield row(kind.replace("_", " "), f"{distance.mean():.1g}", f"{distance.max():.1g}", *angles)


def import_(trunk: Trunk, options: Options) -> Iterator[str]:
    """A case from its own label map against itself."""
    case, spacing = imposed(trunk, "thoracic"), "1.5"
    with tempfile.TemporaryDirectory() as scratch, redirect_stdout(io.StringIO()):
        folder = Path(scratch)
        write_case(folder / "case", case)
        voxelise = [sys.executable, str(ROOT / "scripts" / "voxelise_case.py"), str(folder / "case"), scratch]
        subprocess.run([*voxelise, "--spacing", *[spacing] * 3], check=True, stdout=subprocess.DEVNULL)
        body = ["--body", str(folder / "body.nii.gz"), "--out", str(folder / "imported")]
        command(["import", str(folder / "labels.nii.gz"), *body])
        imported = read_case(folder / "imported")
    made_marks, true_marks = imported.landmarks_before, case.landmarks_before
    distance = np.linalg.norm(made_marks.points - [true_marks.point(name) for name in made_marks.names], axis=1)
    skins = compare_skins(imported.skin, case.skin, case.landmarks_before)
    true, made = (measure(source.skin, source.landmarks_before).bsr for source in (case, imported))
    angles = [abs(a - b) for level in true if (a := true[level]) is not None and (b := made[level]) is not None]
    yield "## Import of a label map\n"
    yield f"A thoracic curve of {CURVES['thoracic']:g}° as voxels of {spacing} mm, imported again.\n"
    yield "| landmarks, mean / largest [mm] | skin, mean [mm] | back surface rotation, mean / largest [°] |"
    yield "|---|---|---|"
    yield row(
        f"{distance.mean():.2f} / {distance.max():.1f}",
        f"{np.abs(skins.signed_distance[skins.counted]).mean():.2f}",
        f"{np.mean(angles):.2f} / {np.max(angles):.2f}",
    )


def plans(trunk: Trunk, options: Options) -> Iterator[str]:
    """Planned angles against what was asked."""
    yield "## Plans\n"
    yield f"Plans that correct {100 * CORRECTION:.0f} % of each curve: the Cobb angle asked for and planned.\n"
    yield "| curve | before [°] | asked [°] | planned [°] | change of a disc's length [mm] |"
    yield "|---|---:|---:|---:|---:|"
    for kind in CURVES:
        case = imposed(trunk, kind)
        after = plan_surgery(case, plan_for(kind, CORRECTION)).landmarks_after
        curves = measure(case.skin, case.landmarks_before).cobb
        first = max(range(len(curves)), key=lambda i: curves[i].angle)
        left = curves_after(curves, after)[first]
        assert left is not None
        asked = (1.0 - CORRECTION) * curves[first].angle
        stretch = np.abs(discs(after) - discs(case.landmarks_before)).max()
        yield row(
            kind.replace("_", " "), f"{curves[first].angle:.1f}", f"{asked:.1f}", f"{left:.1f}", f"{stretch:.0e}"
        )


def ribs(trunk: Trunk, options: Options) -> Iterator[str]:
    """Humps and shoulders after planned surgery beside published means."""
    folders = trunks_in(options.bodies)[: 1 if options.quick else None]
    bodies = {"adult man": trunk} | {folder.name: read_trunk(folder) for folder in folders}
    yield "## Ribs against the clinic\n"
    yield (
        f"Plans that correct {100 * CORRECTION:.0f} %. The fraction by which the hump falls, over that by which "
        "the Cobb angle falls, is 0.58 for thoracic curves of patients (Mattila 2013). Their right shoulder is "
        "7 mm higher before and 1.6 mm lower after surgery (n = 619).\n"
    )
    yield "| body | curve | Cobb angle [°] | hump / Cobb | right shoulder higher by [mm] | inverted | status |"
    yield "|---|---|---:|---:|---:|---:|---|"
    for body, (skin, bones) in bodies.items():
        for kind, cobb in CURVES.items():
            case = make_case(skin, bones, SpineCurve(kind=kind, cobb=cobb, kyphosis=24.0), CORRECTION)
            s = operated(ready(case, options.either(120_000, 150_000), increments=4), plan_for(kind, CORRECTION))
            shoulders = [
                shape.shoulders.difference if shape.shoulders else np.nan for shape in (s.before, s.after)
            ]
            yield row(
                body.replace("_", " "),
                kind.replace("_", " "),
                f"{s.cobb[0]:.0f} to {s.cobb[1]:.0f}",
                f"{s.hump_over_cobb:.2f}",
                f"{shoulders[0]:z.0f} to {shoulders[1]:z.0f}",
                s.inverted,
                s.status.name,
            )


def imposed(trunk: Trunk, kind: str) -> Case:
    """A curve imposed on a trunk."""
    skin, bones = trunk
    curve = SpineCurve(kind=kind, cobb=CURVES[kind], kyphosis=24.0)  # pyright: ignore[reportArgumentType]
    return make_case(skin, bones, curve, CORRECTION)


def ready(
    case: Case,
    tets: int,
    *,
    increments: int = 4,
    tolerance: float = 0.1,
    precision: str = "float32",
    **options: float,
) -> PreparedPatient:
    """A patient ready for her plans."""
    relax = RelaxOptions(tolerance=tolerance)
    return patient_of(
        case,
        RunOptions(
            mesh=COARSE if tets == COARSE.tets else MeshOptions(tets=tets),
            simulation=SimulationOptions(increments=increments, relax=relax),
            precision=precision,  # pyright: ignore[reportArgumentType]
            **options,  # pyright: ignore[reportArgumentType]
        ),
    )


def relaxed(patient: PreparedPatient, case: Case) -> Increment:
    """The last increment of a simulation; raises if it did not converge."""
    last = prepare_plan(patient, case).relax().last
    if last.relaxation.status is not RelaxStatus.CONVERGED:
        print(f"{case.name}: {last.relaxation.status.name}", file=sys.stderr)
    return last


def reported_and_true(last: Increment, truth: np.ndarray) -> tuple[str, str]:
    """Largest distance of a node from the equilibrium, as estimated and from a reference [mm]."""
    true = np.linalg.norm(last.displacement - truth, axis=1).max()
    return f"{last.relaxation.estimated_error:.1g}", f"{true:.1g}"


def noisy(marks: Landmarks, sd: float, random: np.random.Generator) -> Landmarks:
    """Landmarks with normal errors of this standard deviation along each axis [mm]."""
    return Landmarks(marks.names, marks.points + sd * random.standard_normal(marks.points.shape))


def discs(marks: Landmarks) -> np.ndarray:
    """Distance between the facing endplate centres of neighbouring vertebrae [mm]."""
    upper, lower = zip(*itertools.pairwise(marks.vertebrae()), strict=True)
    above = np.array([marks.point(f"{level}_inferior_endplate") for level in upper])
    below = np.array([marks.point(f"{level}_superior_endplate") for level in lower])
    return np.linalg.norm(above - below, axis=1)


def row(*cells: object) -> str:
    """A row of a table."""
    return f"| {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
