"""Fingerprint of the inputs of a simulation, so that a finished result is kept only if they are the same."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from warp_trunk.case.motions import motions_text
from warp_trunk.engine.parallel import choose_device, choose_threads

from .versions import versions

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.geometry.surface import Surface

    from .result import Result

Fingerprint = dict[str, Any]
"""Values of JSON by name: options and constants as they are, everything large as a digest."""
CHANGES_NOTHING = frozenset({"cache", "device", "from_mesh", "live", "record", "threads"})
"""Options that change no displacement, or that are included below by their effect."""
PROGRAMS = ("warp-trunk", "warp-lang", "numpy", "scipy", "tetgen", "trimesh")
"""Programs on which the numbers depend."""

_MARK = "blake2b:"


def fingerprint_of(case: Case, parameters: Mapping[str, Any]) -> Fingerprint:
    """The inputs on which the displacements of a run depend.

    Args:
        case: what is simulated.
        parameters: every option of the run by its own name.

    Raises:
        InputError: a device that is not there, or a number of threads that cannot be.
    """
    device = choose_device(parameters["device"])
    found: Fingerprint = {name: value for name, value in parameters.items() if name not in CHANGES_NOTHING}
    found["device"] = device
    found["threads"] = 1 if device.startswith("cuda") else choose_threads(parameters["threads"])
    found |= anatomy_of(case)
    found["shares of the ribs"] = dataclasses.asdict(case.rib_coupling)
    found |= {f"bone after {name}": surface_digest(surface) for name, surface in case.bones_after.items()}
    found["motions"] = motions_text(case.motions)
    for name, marks in (("before", case.landmarks_before), ("after", case.planned_landmarks)):
        found[f"landmarks_{name}"] = _digest("\n".join(marks.names), marks.points)
    found |= {f"version of {name}": version for name, version in versions().items() if name in PROGRAMS}
    return json.loads(json.dumps(found))  # as it comes back from a file


def anatomy_of(case: Case) -> Fingerprint:
    """The inputs on which mesh and model depend: skin, bones and tissue before surgery."""
    found = {"skin": surface_digest(case.skin), **dataclasses.asdict(case.tissue)}
    found |= {f"bone {name}": surface_digest(surface) for name, surface in case.bones.items()}
    if case.layers is not None:
        given = case.layers
        constants = json.dumps({name: dict(values) for name, values in given.constants.items()}, sort_keys=True)
        labels = b"" if given.mesh is None else given.mesh.read_bytes()
        skin, fat = (np.asarray(one, dtype=np.float64) for one in (given.skin_thickness, given.fat_thickness))
        found["layers of the case"] = _digest(skin, fat, constants, labels)
    return found


def difference(then: Fingerprint, now: Fingerprint) -> str:
    """The first thing in which they differ, in words; empty if they do not."""
    for name in {**now, **then}:
        old, new = then.get(name), now.get(name)
        if old != new:
            large = any(str(value).startswith(_MARK) for value in (old, new))
            return f"'{name}' is another" if large else f"'{name}' was {old} and is {new}"
    return ""


def plan_fingerprint(result: Result) -> str:
    """A short name of exactly this plan and prediction, for a sheet that is signed: it changes with the plan, the
    landmarks before and after, and the predicted skin."""
    marks = (result.landmarks_before, result.landmarks_after)
    points = [np.round(one.points, 3) for one in marks]  # as their files have them
    skins = [np.round(one.vertices, 3).astype(np.float32) for one in (result.skin_before, result.skin)]
    digest = _digest(result.plan or "", *points, *skins).removeprefix(_MARK)[:12]
    return "-".join(digest[first : first + 4] for first in (0, 4, 8))


def _digest(*parts: np.ndarray | str | bytes) -> str:
    digest = hashlib.blake2b(digest_size=20)
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(f"{part.dtype.str} {part.shape}".encode())
            digest.update(np.ascontiguousarray(part).tobytes())
        else:
            digest.update(part.encode() if isinstance(part, str) else part)
    return _MARK + digest.hexdigest()


def surface_digest(surface: Surface) -> str:
    """The digest of a surface."""
    return _digest(surface.vertices, surface.faces)
