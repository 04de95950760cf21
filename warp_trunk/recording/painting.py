"""The numbers behind the colours of the skin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface

from .colours import COLOURS, ColourName
from .energy_density import energy_density

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.model import Model
    from warp_trunk.engine.trunk_mesh import TrunkMesh

Values = Callable[[np.ndarray, float], np.ndarray]
"""From displacements of all nodes (nodes, 3) [mm] and the load factor to a number for each vertex of the skin."""


def painters(
    case: Case, trunk: TrunkMesh, model: Model | None, further: Sequence[str]
) -> dict[ColourName, Values]:
    """How displacement and each further colour get their numbers.

    Only displacement costs next to nothing.

    Raises:
        InputError: as `check_colours`, or energy is asked for without a model.
    """
    check_colours(case, further)
    if "energy" in further and model is None:
        raise InputError("record_colours: 'energy' needs the model; give it to the recording")

    def moved(displacement: np.ndarray) -> Surface:
        return Surface(case.skin.vertices + displacement[trunk.skin_nodes], case.skin.faces)

    def displaced(displacement: np.ndarray, _: float) -> np.ndarray:
        skin = displacement[trunk.skin_nodes]
        return np.sqrt(np.einsum("ij,ij->i", skin, skin))

    def asymmetry(displacement: np.ndarray, load_factor: float) -> np.ndarray:
        from warp_trunk.measures import mirror_asymmetry

        return mirror_asymmetry(moved(displacement), case.landmarks_at(load_factor))

    def distance(displacement: np.ndarray, load_factor: float) -> np.ndarray:
        from warp_trunk.measures.skin_distance import skin_distance

        assert case.actual_skin is not None
        found = skin_distance(moved(displacement), case.actual_skin, case.landmarks_at(load_factor))
        return np.where(found.counted, found.signed, np.nan)

    chosen: dict[ColourName, Values] = {"displacement": displaced}
    if "distance" in further:
        chosen["distance"] = distance
    if "asymmetry" in further:
        chosen["asymmetry"] = asymmetry
    if "energy" in further and model is not None:
        density = energy_density(model, trunk.skin_nodes)
        chosen["energy"] = lambda displacement, _: density(displacement)
    return chosen


def check_colours(case: Case, further: Sequence[str]) -> None:
    """Raises InputError for a colour that is not known, or one that this case cannot have."""
    known = [name for name in COLOURS if name != "displacement"]
    for name in further:
        if name not in known:
            raise InputError(f"record_colours: must be some of {', '.join(known)}, not '{name}'")
    if "distance" in further and case.actual_skin is None:
        raise InputError(
            "record_colours: 'distance' needs the actual skin after surgery and this case has none; leave it out"
        )
