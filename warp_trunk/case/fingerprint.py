"""Fingerprint of a case, so that a mesh or a finished result is kept only if its inputs are the same."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import numpy as np

from warp_trunk.geometry.surface import digest, surface_digest

from .case import Case
from .motions import motions_text

Fingerprint = dict[str, Any]
"""Values of JSON by name: constants as they are, everything large as a digest."""


def anatomy_of(case: Case) -> Fingerprint:
    """The inputs on which mesh and model depend: skin, bones and tissue before surgery."""
    inputs = {"skin": surface_digest(case.skin), **dataclasses.asdict(case.tissue)}
    inputs |= {f"bone {name}": surface_digest(surface) for name, surface in case.bones.items()}
    if case.layers is not None:
        layers = case.layers
        constants = json.dumps({name: dict(values) for name, values in layers.constants.items()}, sort_keys=True)
        labels = b"" if layers.mesh is None else layers.mesh.read_bytes()
        skin, fat = (np.asarray(part, dtype=np.float64) for part in (layers.skin_thickness, layers.fat_thickness))
        inputs["layers of the case"] = digest(skin, fat, constants, labels)
    return inputs


def fingerprint_of(case: Case) -> Fingerprint:
    """Everything of a case on which its result depends, what is known after surgery included."""
    inputs = anatomy_of(case)
    inputs |= {f"bone after {name}": surface_digest(surface) for name, surface in case.bones_after.items()}
    marks = {"landmarks_before": case.landmarks_before, "landmarks_after": case.planned_landmarks,
             "bending_left": case.bending_left, "bending_right": case.bending_right,
             "points": case.points.marks}  # fmt: skip
    inputs |= {name: points and digest("\n".join(points.names), points.points) for name, points in marks.items()}
    inputs |= {"case": case.name, "motions": motions_text(case.motions), "pairs of points": case.points.pairs}
    inputs |= {"plan": case.plan_text, "posture": case.posture, "notes": case.notes}
    inputs["actual_skin"] = None if case.actual_skin is None else surface_digest(case.actual_skin)
    inputs["unseen"] = None if case.unseen is None else digest(case.unseen)
    for name in ("rib_coupling", "study", "uncertainty", "invented"):
        record = getattr(case, name)
        inputs[name] = record and dataclasses.asdict(record)
    return json.loads(json.dumps(inputs))  # as it comes back from a file


def difference(then: Fingerprint, now: Fingerprint) -> str:
    """The first thing in which they differ, in words; empty if they do not."""
    for name in {**now, **then}:
        old, new = then.get(name), now.get(name)
        if old != new:
            large = any(isinstance(value, dict) or len(str(value)) == 40 for value in (old, new))
            return f"'{name}' is another" if large else f"'{name}' was {old} and is {new}"
    return ""
