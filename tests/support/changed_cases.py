"""Other values of every field of a case and of the options of a run, for tests of what is kept.

A test that uses a table sees that it has every field, so that a new one fails until it is decided.
"""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.case.layers import Layers
from warp_trunk.case.motions import Motion
from warp_trunk.case.points import Points
from warp_trunk.case.rib_coupling import RibCoupling
from warp_trunk.case.uncertainty import Invented, Uncertainty
from warp_trunk.geometry.surface import Surface

from .cohort_cases import cohort_options, turned_case

CASE, OPTIONS = turned_case("first", 1.0), cohort_options()


def moved(surface: Surface) -> Surface:
    return surface.moved(surface.vertices + np.array([0.01, 0.0, 0.0]))


def shifted(marks: Landmarks) -> Landmarks:
    return replace(marks, points=marks.points + np.array([0.01, 0.0, 0.0]))


def changed(record: Any) -> list[Any]:
    """The record with each of its numbers changed."""
    return [
        replace(record, **{field.name: 0.99 * getattr(record, field.name) or 0.01}) for field in fields(record)
    ]


CHANGES: dict[str, list[Any]] = {
    "name": ["other"],
    "skin": [moved(CASE.skin)],
    "bones": [CASE.bones | {"T7": moved(CASE.bones["T7"])}],
    "landmarks_before": [shifted(CASE.landmarks_before)],
    "landmarks_after": [shifted(CASE.planned_landmarks)],
    "actual_skin": [moved(CASE.actual_skin or CASE.skin), None],
    "tissue": changed(CASE.tissue),
    "bones_after": [{"T7": moved(CASE.bones["T7"])}],
    "layers": [Layers(skin_thickness=1.5)],
    "rib_coupling": changed(RibCoupling()),
    "uncertainty": changed(Uncertainty()),
    "study": [replace(CASE.study, patient="P9"), replace(CASE.study, pose="bending"),
              replace(CASE.study, months_after=3.0), replace(CASE.study, synthetic=not CASE.study.synthetic)],
    "plan_text": ["uiv = 'T4'"],
    "posture": ["supine"],
    "invented": [Invented(), Invented(share=0.4)],
    "unseen": [np.ones(len(CASE.skin.vertices), dtype=bool)],
    "bending_left": [CASE.landmarks_before],
    "bending_right": [CASE.landmarks_before],
    "points": [Points(CASE.landmarks_before), Points(CASE.landmarks_before, {"a": "b"})],
    "notes": [("The skin was repaired.",)],
    "motions": [{"T7": Motion(translation=(1.0, 0.0, 0.0))}],
}  # fmt: skip
"""Other values of each field of a case: its result, which is kept with its row, depends on all."""

RUN: dict[str, Any] = {
    "mesh": replace(OPTIONS.run.mesh, tets=9000), "simulation": replace(OPTIONS.run.simulation, increments=2),
    "energy": "itmsm", "weights": "volume", "skin_rigidity": 0.1, "precision": "float64", "gravity": 9.81,
    "alpha": 0.1, "rest": "scan", "layers": "depth", "bones": "spline", "bands": True, "from_mesh": Path("a.vtu"),
}  # fmt: skip
RUN_ELSEWHERE = {"constants": "in the tissue of the case", "preset": "says what is refused, and changes no number"}
EXECUTION: dict[str, Any] = {"device": "cuda:0", "threads": 2}
EXECUTION_WITHOUT = {"cache", "record", "view", "yes"}
"""They change no number."""
