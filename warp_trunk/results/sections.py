"""The states of a result as they were measured, in a file: sections, contacts, shoulders and waist."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import msgspec
import numpy as np

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.errors import InputError
from warp_trunk.measures import TrunkMeasures
from warp_trunk.measures.back_rotation import Contacts, DualTangent, tangent_at
from warp_trunk.measures.measures import measure_spine
from warp_trunk.measures.outlines import Shoulders, Waist

_WORDS = "numbers"
"""The entry that holds what is no array, as JSON."""


@dataclass(frozen=True, kw_only=True)
class _Numbers:
    """The part of `TrunkMeasures` of the skin that is no section, under the same names."""

    levels: tuple[str, ...]
    """The levels that were cut."""
    slopes: dict[str, float | None]
    waist: Waist | None
    shoulders: Shoulders | None
    unseen_humps: frozenset[str]
    unseen_flanks: frozenset[str]
    skin_change_max: float | None
    skin_change_mean: float | None
    missing: dict[str, str] = field(default_factory=dict)


_SHARED = tuple(field.name for field in fields(_Numbers) if field.name != "levels")


def write_sections(path: Path, states: Mapping[str, TrunkMeasures]) -> None:
    """Write the measured states of a result by their names, as arrays of NumPy."""
    arrays = dict[str, np.ndarray]()
    words = dict[str, _Numbers]()
    for state, measures in states.items():
        shared = {name: getattr(measures, name) for name in _SHARED}
        words[state] = _Numbers(levels=tuple(measures.outlines), **shared)
        for level, outline in measures.outlines.items():
            if outline is not None:
                arrays[f"{state}/{level}/outline"] = outline
        for level, tangent in measures.tangents.items():
            if tangent is not None:
                points, edges, nearest = tangent.contacts
                arrays[f"{state}/{level}/contacts"] = np.stack([points, *edges, nearest])
                if tangent.seen is not None:
                    arrays[f"{state}/{level}/seen"] = tangent.seen
    content: dict[str, Any] = {_WORDS: np.array(msgspec.json.encode(words).decode()), **arrays}
    with path.open("wb") as file:
        np.savez_compressed(file, **content)


def read_sections(path: Path, landmarks: Mapping[str, Landmarks]) -> dict[str, TrunkMeasures]:
    """The measured states of a result, by their names.

    Args:
        path: the file.
        landmarks: those of each state.

    Raises:
        InputError: the file is missing, damaged or of other states.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            words = msgspec.json.decode(str(file[_WORDS]), type=dict[str, _Numbers])
            arrays = {name: file[name] for name in file.files if name != _WORDS}
        return {state: _measured(state, entry, landmarks[state], arrays) for state, entry in words.items()}
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, msgspec.MsgspecError) as error:
        raise InputError(f"{path}: cannot be read ({error}); simulate the case again") from error


def _measured(
    state: str, numbers: _Numbers, landmarks: Landmarks, arrays: Mapping[str, np.ndarray]
) -> TrunkMeasures:
    measures = measure_spine(landmarks)
    spine, line = measures.spine, measures.sacral_line
    outlines: dict[str, np.ndarray | None] = {
        level: arrays.get(f"{state}/{level}/outline") for level in numbers.levels
    }

    def tangent_of(level: str, outline: np.ndarray | None) -> DualTangent | None:
        contacts = arrays.get(f"{state}/{level}/contacts")
        if outline is None or contacts is None or line is None:
            return None
        points, left, right, nearest = contacts
        centroid = spine.centroids[spine.levels.index(level)]
        pair = Contacts(points, np.stack([left, right]), nearest)
        return tangent_at(outline, centroid, line.across, pair, arrays.get(f"{state}/{level}/seen"))

    return replace(
        measures,
        outlines=outlines,
        tangents={level: tangent_of(level, outline) for level, outline in outlines.items()},
        **{name: getattr(numbers, name) for name in _SHARED},
    )
