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
    from warp_trunk.case.landmarks import Landmarks
    from warp_trunk.case.layers import Layers
    from warp_trunk.engine.trunk_mesh import TrunkMesh
    from warp_trunk.geometry.surface import Surface

Fingerprint = dict[str, Any]
"""Values of JSON by name: options and constants as they are, everything large as a digest."""
CHANGES_NOTHING = frozenset({"cache", "device", "from_mesh", "live", "record", "threads"})
"""Options that change no displacement, or that are included below by their effect."""
PROGRAMS = ("warp-trunk", "warp-lang", "numpy", "scipy", "tetgen", "trimesh")
"""Programs on which the numbers depend."""

_MARK = "blake2b:"


def fingerprint_of(case: Case, parameters: Mapping[str, Any], trunk: TrunkMesh | None = None) -> Fingerprint:
    """The inputs on which the displacements of a run depend.

    Args:
        case: what is simulated.
        parameters: every option of the run by its own name.
        trunk: the mesh where it was made elsewhere; one that is made here follows from case and options.

    Raises:
        InputError: a device that is not there, or a number of threads that cannot be.
    """
    device = choose_device(parameters["device"])
    found: Fingerprint = {name: value for name, value in parameters.items() if name not in CHANGES_NOTHING}
    found["device"] = device
    found["threads"] = 1 if device.startswith("cuda") else choose_threads(parameters["threads"])
    found |= dataclasses.asdict(case.tissue)
    found["shares of the ribs"] = dataclasses.asdict(case.rib_shares)
    found["skin"] = surface_digest(case.skin)
    for when, bones in (("bone", case.bones), ("bone after", case.bones_after)):
        found |= {f"{when} {name}": surface_digest(surface) for name, surface in bones.items()}
    found["motions"] = motions_text(case.motions)
    found["landmarks_before"] = _landmarks(case.landmarks_before)
    found["landmarks_after"] = _landmarks(case.planned_landmarks)
    found["layers of the case"] = None if case.layers is None else _layers(case.layers)
    found["mesh made elsewhere"] = None if trunk is None else _trunk(trunk)
    found |= {f"version of {name}": version for name, version in versions().items() if name in PROGRAMS}
    return json.loads(json.dumps(found))  # as it comes back from a file


def difference(then: Fingerprint, now: Fingerprint) -> str:
    """The first thing in which they differ, in words; empty if they do not."""
    for name in {**now, **then}:
        old, new = then.get(name), now.get(name)
        if old != new:
            large = any(str(value).startswith(_MARK) for value in (old, new))
            return f"'{name}' is another" if large else f"'{name}' was {old} and is {new}"
    return ""


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


def _landmarks(landmarks: Landmarks) -> str:
    return _digest("\n".join(landmarks.names), landmarks.points)


def _layers(layers: Layers) -> str:
    constants = json.dumps({name: dict(values) for name, values in layers.constants.items()}, sort_keys=True)
    labels = b"" if layers.mesh is None else layers.mesh.read_bytes()
    return _digest(
        np.asarray(layers.skin_thickness, dtype=np.float64), np.asarray(layers.fat_thickness), constants, labels
    )


def _trunk(trunk: TrunkMesh) -> str:
    tissue = np.zeros(0) if trunk.tissue is None else trunk.tissue
    return _digest(trunk.nodes, trunk.tets, trunk.skin_nodes, trunk.skin_faces, trunk.bone, tissue)
