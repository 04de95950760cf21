"""Standing backs of patients beside the backs that their own spines give when they are imposed on a body.

    python scripts/compare_patients.py PATIENTS ANATOMY BODIES > table.md
    python scripts/compare_patients.py PATIENTS ANATOMY BODIES --figure docs/figures/patients.png

PATIENTS holds a folder for each patient: back.ply (points), spine_line.csv (vertebral bodies), spinous_line.csv
and markers.csv, in mm and LPS. ANATOMY and BODIES are those of compare_bodies.py; the body nearest in the length
of the spine gets the spine. Vertebrae stand at their usual heights, and turn with their sideways way. The twist of
a trunk that faces the scanner above a pelvis that does not is no part of a spine's line, and is added. Nothing is
simulated: this compares the imposed back, not a prediction.
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from trunks import read_trunk, trunks_in

from warp_trunk import InputError, Landmarks, Surface
from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import read_landmarks
from warp_trunk.io.point_files import read_points
from warp_trunk.measures import measure_back
from warp_trunk.measures.back import vertebrae_on_line
from warp_trunk.measures.markers import BackMarkers, back_markers
from warp_trunk.measures.rows import as_markdown
from warp_trunk.preparation.deformity.deformity import impose
from warp_trunk.preparation.deformity.spine_curve import MeasuredSpine, measured_spine
from warp_trunk.preparation.landmark_finder import find_landmarks
from warp_trunk.spine.cobb import cobb_angles
from warp_trunk.spine.spine import spine_of

LEVELS = ("T4", "T6", "T8", "T10", "T12", "L1", "L2", "L3", "L4")
"""Those whose errors are averaged."""
UPPER = ("T4", "T5", "T6", "T7")
"""Those of the shoulder girdle."""
MEASURES = ("dual tangent", "slope")
TWIST = np.linspace(1.0, 0.0, len(VERTEBRAE))
"""The part of a pelvis' turn by which a back is turned against it, T1 to L5: shoulders face the scanner, and the
spine between twists evenly. The scanner faces as pelvises do in the mean."""
CURVE = 20.0
"""A curve of fewer degrees makes no patient a member of a group."""
Body = tuple[Surface, dict[str, Surface], Landmarks]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of the comparison."""

    patients: tyro.conf.Positional[Path]
    """Folder of folders of patients."""
    anatomy: tyro.conf.Positional[Path]
    """Folder with skin.ply and bones/ of a straight trunk."""
    bodies: tyro.conf.Positional[Path]
    """Folder of such folders."""
    turn: float = 0.55
    """Turn of a vertebra for each mm of sideways way from the line between T1 and L5 [degrees/mm]."""
    figure: Path | None = None
    """PNG file for profiles of the groups."""


@dataclass(frozen=True, eq=False)
class Patient:
    """One patient and her spine on a body; all by level T1 to L5, positive to the right or right side back."""

    way: np.ndarray
    """Sideways way of the vertebrae from the line between T1 and L5 [mm], shape (17,)."""
    real: np.ndarray
    """Dual tangent and slope of the scan [degrees], shape (2, 17); NaN where missing."""
    imposed: np.ndarray
    """The same of the imposed back, without the twist of the trunk."""
    pelvis: float
    """How far her pelvis is turned in the axes of the scan, positive where its left side stands further back
    [degrees]."""
    thoracic: float
    """Cobb angle of the largest thoracic curve, positive where it is convex to the right [degrees]."""
    lumbar: float
    """The same of the thoracolumbar or lumbar one."""

    @property
    def group(self) -> str:
        """The group she belongs to; empty for none."""
        if self.thoracic >= CURVE and self.thoracic > abs(self.lumbar):
            return "right thoracic"
        if self.lumbar <= -CURVE and self.thoracic >= 0.0:
            return "right thoracic, left lumbar larger"
        return ""


def main(options: Options) -> None:
    """Prints the tables and draws the figure."""
    bodies = [read_body(folder) for folder in (options.anatomy, *trunks_in(options.bodies))]
    patients = []
    for folder in sorted(path for path in options.patients.iterdir() if (path / "back.ply").is_file()):
        try:
            patients.append(compared(folder, bodies, options.turn))
        except InputError as error:
            print(f"left out: {error}", file=sys.stderr, flush=True)
    facing = float(np.mean([p.pelvis for p in patients]))
    twisted = [replace(p, imposed=p.imposed + (p.pelvis - facing) * TWIST) for p in patients]
    for number, measure in enumerate(MEASURES):
        print(f"\n{measure}, {len(patients)} patients\n\n{table(twisted, number)}")
        print(table(patients, number).splitlines()[-1].replace("levels", "levels without the twist"))
    print(f"\n{groups(twisted)}")
    if options.figure is not None:
        draw(twisted, options.figure)


def read_body(folder: Path) -> Body:
    """A straight trunk with its landmarks."""
    skin, bones = read_trunk(folder)
    return skin, bones, find_landmarks(bones).complete()


def length(marks: Landmarks) -> float:
    """Between the middles of T1 and L5 [mm]."""
    spine = spine_of(marks)
    return float(spine.centroids[0, 2] - spine.centroids[-1, 2])


def compared(folder: Path, bodies: list[Body], turn: float) -> Patient:
    """Measure a patient's back, and that which her spine gives on the body nearest in length."""
    points, markers = read_points(folder / "back.ply"), read_landmarks(folder / "markers.csv")
    real = measure_back(points, read_points(folder / "spinous_line.csv"), markers)
    axes = back_markers(markers)
    spine, way = spine_of_patient(folder, axes, turn)
    centres = vertebrae_on_line(read_points(folder / "spine_line.csv"), axes)
    long = centres[0, 2] - centres[-1, 2]
    skin, bones, marks = min(bodies, key=lambda body: abs(length(body[2]) - long))
    deformed, _, landmarks = impose(skin, bones, marks, spine)
    imposed = measure_back(deformed, landmarks)
    curves = {"T": 0.0, "L": 0.0}
    for curve in cobb_angles(landmarks):
        part = "T" if VERTEBRAE.index(curve.apex) < VERTEBRAE.index("T12") else "L"
        signed = curve.angle if curve.convex == "right" else -curve.angle
        curves[part] = max(curves[part], signed, key=abs)
    angles = [
        np.array([[np.nan if value is None else value for value in row[2:]] for row in back.rows()]).T
        for back in (real, imposed)
    ]
    across = axes.across
    pelvis = float(np.degrees(np.arctan2(across[1], across[0])))
    return Patient(way, angles[0], angles[1], pelvis, curves["T"], curves["L"])


def spine_of_patient(folder: Path, markers: BackMarkers, turn: float) -> tuple[MeasuredSpine, np.ndarray]:
    """The spine in the axes of her pelvis, and its way to the right [mm], shape (17,)."""
    centres = vertebrae_on_line(read_points(folder / "spine_line.csv"), markers)
    c, s = markers.across
    body = np.column_stack([centres[:, :2] @ np.array([[c, -s], [s, c]]), centres[:, 2]])
    way = np.interp(body[:, 2], body[[-1, 0], 2], body[[-1, 0], 0]) - body[:, 0]
    return measured_spine(folder.name, body, -np.radians(turn) * way), way


def table(patients: list[Patient], measure: int) -> str:
    """Real beside imposed by level, and over all levels."""
    head = ["level", "real [°]", "imposed [°]", "gain, real [°/mm]", "gain, imposed", "r", "error [°]", "floor"]
    rows, errors = [], []
    for name, levels in [*((level, (level,)) for level in LEVELS), ("T4 to T7", UPPER)]:
        at = [VERTEBRAE.index(level) for level in levels]
        each = np.hstack([np.array([p.way, p.real[measure], p.imposed[measure]])[:, at] for p in patients])
        way, real, imposed = each[:, np.isfinite(each).all(axis=0)]
        floor = np.abs(real - np.polyval(np.polyfit(imposed, real, 1), imposed)).mean()
        error = (np.abs(real - imposed).mean(), floor, np.abs(real).mean())
        if len(levels) == 1:
            errors.append(error)
        cells = [f"{real.mean():.1f}", f"{imposed.mean():.1f}", gain(way, real), gain(way, imposed)]
        cells += [f"{np.corrcoef(real, imposed)[0, 1]:.2f}", *(f"{number:.2f}" for number in error)]
        rows.append([name, *cells])
    rows.append(["mean of the levels", *[""] * 5, *(f"{number:.2f}" for number in np.mean(errors, axis=0))])
    return as_markdown([*head, "zero"], rows)


def gain(way: np.ndarray, angle: np.ndarray) -> str:
    """Slope of the line of angles over ways with its 95 % interval."""
    from scipy.stats import t

    (slope, _), covariance = np.polyfit(way, angle, 1, cov=True)
    half = float(t.ppf(0.975, len(way) - 2)) * np.sqrt(covariance[0, 0])
    return f"{slope:.2f} ({slope - half:.2f} to {slope + half:.2f})"


def by_group(patients: list[Patient]) -> dict[str, list[Patient]]:
    """The patients of each group."""
    names = sorted({patient.group for patient in patients} - {""})
    return {name: [patient for patient in patients if patient.group == name] for name in names}


def groups(patients: list[Patient]) -> str:
    """Means of the groups, the dual tangent by level."""
    rows = []
    at = [VERTEBRAE.index(level) for level in LEVELS]
    for name, members in by_group(patients).items():
        curves = np.mean([(patient.thoracic, patient.lumbar) for patient in members], axis=0)
        for kind in ("real", "imposed"):
            mean = np.nanmean([getattr(patient, kind)[0][at] for patient in members], axis=0)
            title = f"{name}, {curves[0]:.0f}° and {curves[1]:.0f}°"
            rows.append([title, str(len(members)), kind, *(f"{value:.1f}" for value in mean)])
    return as_markdown(["group", "n", "back", *LEVELS], rows)


def draw(patients: list[Patient], file: Path) -> None:
    """Profiles of the groups: mean and standard deviation by level, real and imposed."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    members = by_group(patients)
    figure, axes = plt.subplots(1, len(members), figsize=(4.2 * len(members), 5.0), sharey=True, squeeze=False)
    rows = np.arange(3, len(VERTEBRAE) - 1)
    for ax, (name, group) in zip(axes[0], members.items(), strict=True):
        for kind, colour in (("real", "black"), ("imposed", "tab:red")):
            values = np.array([getattr(patient, kind)[0][rows] for patient in group])
            mean, deviation = np.nanmean(values, axis=0), np.nanstd(values, axis=0)
            ax.plot(mean, -rows, color=colour, label=kind)
            ax.fill_betweenx(-rows, mean - deviation, mean + deviation, color=colour, alpha=0.15, lw=0.0)
        ax.axvline(0.0, color="grey", lw=0.5)
        ax.set_title(f"{name} (n = {len(group)})", fontsize=10)
        ax.set_xlabel("right side back [°], mean ± SD")
        ax.set_yticks(-rows, [VERTEBRAE[row] for row in rows])
    axes[0][0].legend(frameon=False)
    figure.tight_layout()
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
