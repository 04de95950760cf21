"""The choice of colours of the skin: what each shows, its values, and how a number becomes a colour."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.model import Model
    from warp_trunk.engine.trunk_mesh import TrunkMesh

FurtherColour = Literal["distance", "asymmetry", "energy"]
ColourName = Literal["displacement", "distance", "asymmetry", "energy"]


def _shades(*anchors: tuple[int, int, int]) -> np.ndarray:
    at = np.linspace(0.0, 1.0, len(anchors))
    channels = [np.interp(np.linspace(0.0, 1.0, 256), at, channel) for channel in zip(*anchors, strict=True)]
    return np.column_stack(channels).round().astype(np.uint8)


RISING = _shades((255, 246, 222), (253, 187, 132), (227, 74, 51), (127, 0, 0))
"""Pale over red to dark red, shape (256, 3): lightness falls all the way."""
TURNING = _shades((5, 48, 97), (67, 147, 195), (247, 247, 247), (214, 96, 77), (103, 0, 31))
"""Dark blue over white to dark red, shape (256, 3). Both maps read for every kind of colour vision."""
UNKNOWN = (128, 128, 128)
"""Where there is no number."""


@dataclass(frozen=True)
class Colour:
    """One choice of colour."""

    name: ColourName
    """Its entity below /now/skin and /scale."""
    tab: str
    """Its name in the viewer."""
    red: str
    """The meaning of dark red; the title of its scale."""
    unit: str
    """Unit of its numbers."""
    signed: bool = False
    """Whether its numbers lie on both sides of 0, which is then white."""

    def painted(self, values: np.ndarray, most: float) -> np.ndarray:
        """Colours (n, 3), uint8, of values (n,): dark red at `most`; grey where a value is NaN."""
        share = values / max(most, 1e-12)
        if self.signed:
            share = 0.5 + 0.5 * share
        known = ~np.isnan(share)
        place = np.where(known, 255.0 * np.clip(share, 0.0, 1.0), 0.0).round().astype(np.uint8)
        colours = (TURNING if self.signed else RISING)[place]
        colours[~known] = UNKNOWN
        return colours


COLOURS: dict[ColourName, Colour] = {
    colour.name: colour
    for colour in (
        Colour("displacement", "Displacement", "Displacement from before surgery: dark red moved furthest", "mm"),
        Colour(
            "distance",
            "Distance to actual",
            "Distance to the actual skin: red lies outside it, blue inside, grey is not counted",
            "mm",
            signed=True,
        ),
        Colour(
            "asymmetry",
            "Asymmetry",
            "Left against right: red stands out beyond the mirror image of the other side, blue lies inside it",
            "mm",
            signed=True,
        ),
        Colour(
            "energy", "Energy density", "Energy of the tissue under the skin: dark red is strained most", "per cm³"
        ),
    )
}


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


def energy_density(model: Model, skin_nodes: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """A function from displacements before surgery (nodes, 3) [mm] to the energy around each vertex of the skin.

    That is the energy of the tetrahedra at a vertex, without gravity, by their volume at rest: in units of the
    model's energy for each cm^3, shape (skin vertices,).
    """
    number = np.empty(len(model.order), dtype=np.int64)
    number[model.order] = np.arange(len(model.order))
    vertices = number[skin_nodes]
    at_skin = np.zeros(len(model.order), dtype=bool)
    at_skin[vertices] = True
    tets = np.flatnonzero(at_skin[model.corners].any(axis=1))
    corners = model.corners[tets]
    volume = model.elements.rest_volume.numpy()[tets].astype(np.float64) / 1000.0

    def around(values: np.ndarray) -> np.ndarray:
        return np.bincount(corners.ravel(), np.repeat(values, 4), len(model.order))[vertices]

    def density(displacement: np.ndarray) -> np.ndarray:
        return around(tet_energies(model, tets, displacement)) / around(volume)

    return density


def tet_energies(model: Model, tets: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    """Energy of each of some tetrahedra, by its number in the model, without gravity; shape (tets,), float64.

    Edges and faces give each tetrahedron its share, so that over all of them it is the energy of the model.
    """
    moved = displacement[model.order]
    if model.scan is not None:
        moved = moved + model.scan
    corners = model.corners[tets]
    rest = model.rest[corners]
    return model.elements.of_tets(tets, rest, rest + moved[corners])
