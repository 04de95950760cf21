"""Bands: how sure each number of a prediction is, from stated sources of error.

Each source changes each number in proportion, by its sensitivity; sources are independent, so their variances add.
Draws of all errors at once, whose tissue follows by one linear solve each, show the skin, and whether proportion
holds: the measures of a drawn skin are compared with what the sensitivities say of the same draw. Where they
differ, the deviation is corrected by the ratio of the two, which is 1 for a number in proportion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.case.uncertainty import REFERENCES
from warp_trunk.engine.linearization import Linearization
from warp_trunk.errors import InputError
from warp_trunk.results.bands import Band, Bands, BandSource, FoundBands

from .draws import Scene
from .options import RunOptions
from .prepare import Prepared
from .sensitivities import Sensitivity, sensitivities
from .sources import Source, effect_of, sources_of
from .spine_bands import spine_bands

if TYPE_CHECKING:
    from warp_trunk.case import Case
    from warp_trunk.engine.relaxation import Relaxer
    from warp_trunk.engine.simulation import Increment

DRAWS = 32
"""Draws of all errors; a standard deviation of so many is known to an eighth of itself."""
_LANDMARKS, _MESH = "landmarks", "mesh"


def find_bands(
    case: Case,
    prepared: Prepared,
    increment: Increment,
    options: RunOptions | None = None,
    *,
    draws: int = DRAWS,
    seed: int = 1,
    relaxer: Relaxer | None = None,
) -> FoundBands:
    """How sure the numbers of a prediction are, by the sources of error that the case states.

    Args:
        case: what was simulated, with its `uncertainty`.
        prepared: what `prepare` made of it.
        increment: the last increment that `simulate` yielded.
        options: those that `prepare` was given.
        draws: of all errors at once; they show the skin and whether numbers change in proportion, at least 2.
        seed: of the draws.
        relaxer: what relaxed the increment, see `Linearization`; made when left out.

    Raises:
        InputError: the last relaxation did not converge, or fewer than two draws.
    """
    if draws < 2:
        raise InputError(f"bands: 'draws' must be at least 2, not {draws}")
    options = options or RunOptions()
    linear = Linearization(prepared.model, increment, relaxer=relaxer)
    found = sensitivities(case, prepared, increment, options, linear=linear)
    sources = sources_of(case, prepared, options)
    effects = {source.name: np.array([effect_of(source, one) for one in found]) for source in sources}
    marks = _landmark_sd(case, found)
    mesh = np.array([_mesh_sd(case, one) for one in found])
    scene = Scene(case, prepared, options, linear, increment, found)
    drawn = scene.draw(sources, np.array([*effects.values()]), draws, np.random.default_rng(seed))
    shared = sum((effect**2 for effect in effects.values()), start=marks["apart"] ** 2)
    kept = [effects[source.name] ** 2 for source in sources if not source.of_surgery]
    exact = sum(kept, start=marks["same"] ** 2)
    sds = np.sqrt(shared * drawn.ratio**2 + mesh**2)
    bands = {
        one.name: Band.of(one.value, float(sd), linear=bool(straight))
        for one, sd, straight in zip(found, sds, drawn.linear, strict=True)
    }
    skin_sd = np.sqrt(drawn.skin**2 + case.uncertainty.mesh_length**2)
    return FoundBands(
        Bands(
            bsr_deg=_of_kind(bands, "bsr "),
            max_hump_mm=next(iter(_of_kind(bands, "hump ").values()), None),
            shoulder_difference_mm=bands.get("shoulder difference"),
            spine=spine_bands(case, sources),
            exact={
                one.name: Band.of(one.value, float(sd))
                for one, sd in zip(found, np.sqrt(exact * drawn.ratio**2 + mesh**2), strict=True)
            },
            sources=_ranked(case, found, sources, {**effects, _LANDMARKS: marks["apart"], _MESH: mesh}),
            left_out=_left_out(prepared, options),
            skin_mean_mm=float(skin_sd.mean()),
            skin_max_mm=float(skin_sd.max()),
            draws=draws,
        ),
        skin_sd,
    )


def _landmark_sd(case: Case, found: Sequence[Sensitivity]) -> dict[str, np.ndarray]:
    """What errors of landmarks do to each number: of their own before and after (`apart`), or the `same`."""
    sd = case.uncertainty.landmark_sd
    apart = [float(np.linalg.norm([one.landmarks_before, one.landmarks_after])) for one in found]
    same = [float(np.linalg.norm(one.landmarks_before + one.landmarks_after)) for one in found]
    return {"apart": sd * np.array(apart), "same": sd * np.array(same)}


def _mesh_sd(case: Case, one: Sensitivity) -> float:
    given = case.uncertainty
    return given.mesh_rotation if one.unit == "degrees" else given.mesh_length


def _of_kind(bands: Mapping[str, Band], prefix: str) -> dict[str, Band]:
    return {name.removeprefix(prefix): band for name, band in bands.items() if name.startswith(prefix)}


def _ranked(
    case: Case, found: Sequence[Sensitivity], sources: Sequence[Source], effects: Mapping[str, np.ndarray]
) -> tuple[BandSource, ...]:
    """Every source with its effects, the largest for back surface rotation first."""
    given = case.uncertainty
    texts = {source.name: (source.spread, source.reference) for source in sources}
    size = f"{given.landmark_error:g} ± {given.landmark_error_sd:g} mm, before and after each"
    texts[_LANDMARKS] = (size, REFERENCES["landmark_error"])
    texts[_MESH] = (f"{given.mesh_rotation:g} degrees, {given.mesh_length:g} mm", REFERENCES["mesh"])
    rotation = np.array([one.unit == "degrees" for one in found])
    order = sorted(effects, key=lambda name: -float(np.square(effects[name][rotation]).sum()))
    return tuple(
        BandSource(
            name=name,
            spread=texts[name][0],
            reference=texts[name][1],
            sd={one.name: abs(float(sd)) for one, sd in zip(found, effects[name], strict=True)},
        )
        for name in order
    )


def _left_out(prepared: Prepared, options: RunOptions) -> tuple[str, ...]:
    said = []
    if prepared.model.scan is not None:
        said.append(
            "the constants of the tissue: under gravity they move the rest state too, which is not followed"
        )
    if options.bones != "spline":
        said.append("how ribs follow: it is known for bones that the spline carries")
    return tuple(said)
