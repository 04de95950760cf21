"""Errors of a case that is fitted to a scan of the back, where the whole body is known.

Curves are imposed on whole bodies, their backs are cut as a scanner sees them, and a case is fitted to each with
the body that the program makes. Both cases get the same plan and are simulated: the table has the predicted
rotation of the back from the fitted case less that from the whole body, and the errors of what is invented.

    uv run python scripts/compare_fitted_backs.py shared/bodies girl13 girl15_slim woman --out results/fitted
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from trunks import read_trunk

from warp_trunk import (
    Case,
    CurvePlan,
    Execution,
    Landmarks,
    MeshOptions,
    Plan,
    RunOptions,
    SimulationOptions,
    simulate,
)
from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.geometry.distance_field import SurfaceDistance
from warp_trunk.measures.quantities import BEFORE, PREDICTED
from warp_trunk.measures.rows import as_markdown
from warp_trunk.preparation.back_scan import fit_back
from warp_trunk.preparation.back_scan.scan import cut_back
from warp_trunk.preparation.deformity import SpineCurve, make_case
from warp_trunk.spine import cobb_angles

CURVES = {
    "thoracic": (SpineCurve(cobb=50.0), ("T4", "L1")),
    "thoracolumbar": (SpineCurve(kind="thoracolumbar", cobb=45.0), ("T10", "L4")),
}
"""Curves and the vertebrae between which they are corrected."""
LEVELS = VERTEBRAE[3:16]
CORRECTION = 0.65
OPTIONS = RunOptions(mesh=MeshOptions(tets=120_000), simulation=SimulationOptions(increments=2))


def main(
    bodies: tyro.conf.Positional[Path],
    names: tyro.conf.Positional[tuple[str, ...]],
    out: Path = Path("results/fitted_backs"),
) -> None:
    """Prints the table, after each body what is known of it, and writes it as JSON."""
    out.mkdir(parents=True, exist_ok=True)
    for name in names:
        skin, bones = read_trunk(bodies / name)
        for kind in CURVES:
            file = out / f"{name}_{kind}.json"
            if not file.exists():
                text = json.dumps(compared(make_case(skin, bones, CURVES[kind][0], 0.0), kind))
                file.write_text(text, encoding="utf-8", newline="\n")
            print(name, kind, file.read_text(encoding="utf-8"), flush=True)
    print(table([json.loads(file.read_text(encoding="utf-8")) for file in sorted(out.glob("*.json"))]))


def compared(whole: Case, kind: str) -> dict[str, Any]:
    """Rotation of the back before and as predicted from both cases, and the errors of what is invented."""
    whole = replace(whole, landmarks_after=None)
    fit = fit_back(*cut_back(whole))
    comparison: dict[str, Any] = {"distance": float(fit.distance.mean()), "share": fit.invented}
    comparison |= errors_of_invented(whole, fit.case)
    (uiv, liv), place = CURVES[kind][1], ""
    for case, which in ((whole, "whole"), (fit.case, "fitted")):
        main_curve = max(cobb_angles(case.landmarks_before), key=lambda curve: curve.angle)
        plan = Plan(uiv=uiv, liv=liv, curves=(CurvePlan(main_curve.apex, correction=CORRECTION),))
        result = simulate(case, plan, OPTIONS, Execution(record=False))
        place = place or result.table.place("main_hump_mm") or ""  # of the whole body, also for the fitted case
        comparison[which] = {
            "status": result.status.name,
            "inverted": result.summary.inverted_tets,
            "before": rotations(result.measures_before),
            "after": rotations(result.measures),
            "hump": [result.table.value(state, "hump_mm", place) for state in (BEFORE, PREDICTED)],
        }
    return comparison


def rotations(measures: Any) -> list[float]:
    """The rotation of the back at `LEVELS` [degrees]; NaN where there is none."""
    return [np.nan if (angle := measures.bsr.get(level)) is None else float(angle) for level in LEVELS]


def errors_of_invented(whole: Case, fitted: Case) -> dict[str, float]:
    """Root mean square errors of ribs, turn of vertebrae and pelvis, and unseen skin."""
    ribs = [name for name in whole.bones.keys() & fitted.bones.keys() if name.startswith("rib_")]
    off = [SurfaceDistance(whole.bones[name]).at(fitted.bones[name].vertices) for name in ribs]
    fitted_marks, true_marks = fitted.landmarks_before, whole.landmarks_before
    turn = [turn_of(fitted_marks, level) - turn_of(true_marks, level) for level in VERTEBRAE]
    assert fitted.unseen is not None
    low = fitted.skin.vertices[fitted.unseen]
    low = low[low[:, 2] < whole.landmarks_before.point("T1_superior_endplate")[2]]
    front = SurfaceDistance(whole.skin).at(low)
    return {
        "ribs": float(np.sqrt(np.mean(np.square(np.concatenate(off))))),
        "turn": float(np.sqrt(np.mean(np.square(turn)))),
        "front": float(np.sqrt(np.mean(np.square(front)))),
    }


def turn_of(landmarks: Landmarks, level: str) -> float:
    """The turn of a vertebra about z [degrees], from its pedicles."""
    across = landmarks.point(f"{level}_left_pedicle_superior") - landmarks.point(f"{level}_right_pedicle_superior")
    return float(np.degrees(np.arctan2(across[1], across[0])))


def table(results: list[dict[str, Any]]) -> str:
    """By level, the fitted case minus the whole body: root mean square and mean."""

    def of(which: str, when: str) -> np.ndarray:
        return np.array([result[which][when] for result in results], dtype=np.float64)  # NaN where there is none

    before, after = (of("fitted", when) - of("whole", when) for when in ("before", "after"))
    rows = []
    for name, at in (*((level, [row]) for row, level in enumerate(LEVELS)), ("all", slice(None))):
        sizes = [np.sqrt(np.nanmean(np.square(part[:, at]))) for part in (before, after, after - before)]
        rows.append([name, *(f"{size:.2f}" for size in sizes), f"{np.nanmean(after[:, at]):+.2f}"])
    names = ("ribs", "turn", "front", "distance", "share")
    means = {name: np.mean([result[name] for result in results]) for name in names}
    hump = of("fitted", "hump")[:, 1] - of("whole", "hump")[:, 1]
    off = f"{np.sqrt(np.nanmean(np.square(hump))):.1f} mm (root mean square of {np.isfinite(hump).sum()})"
    by_level = as_markdown(["level", "before", "predicted", "change", "predicted, mean"], rows)
    return f"{by_level}\n{means}; predicted hump off by {off}"


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
