"""The rows of the error budget: what is varied, and what it is compared with."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

from .choices import Choices
from .errors import BONE_MEAN, LANDMARK_MEAN, LANDMARK_SD

Group = Literal["computation", "model", "input"]
DEFAULT = Choices()
PAPERS = Choices(bones="spline", energy="itmsm")
BY_VOLUME = replace(PAPERS, weights="volume")
BENT = replace(PAPERS, energy="neo-hookean")
"""The continuum between bones that the spline bends."""
EXACT = Choices(precision="float64", tolerance=1e-6)
FINEST = 950_000
G = 9.81


@dataclass(frozen=True)
class Row:
    """One row of the budget."""

    label: str
    """What is varied."""
    group: Group
    """Whose error it is: the computation's, the model's, or that of what the clinic gives."""
    against: Choices
    """The run it is compared with."""
    runs: tuple[Choices, ...]
    """The varied run, or one for each sample."""
    measured_with_error: bool = False
    """Whether the rotation is measured by the landmarks with their errors as well."""


def _vary(
    group: Group, against: Choices, varied: dict[str, dict[str, Any]], start: Choices | None = None
) -> list[Row]:
    """A row for each label and what it changes of a run; of the one compared with, where none is given."""
    return [Row(label, group, against, (replace(start or against, **change),)) for label, change in varied.items()]


_VARIED: list[Row] = [
    *_vary(
        "computation",
        EXACT,
        {
            f"tolerance {tolerance:g} mm{note}, against 1e-6 mm": {"tolerance": tolerance}
            for tolerance, note in ((1.0, ""), (0.1, ""), (0.01, " (default)"))
        },
        DEFAULT,
    ),
    *_vary(
        "computation",
        DEFAULT,
        {
            "float64 instead of float32": {"precision": "float64"},
            "1 increment instead of 10": {"increments": 1},
            "5 increments instead of 10": {"increments": 5},
            "20 increments instead of 10": {"increments": 20},
        },
    ),
    *_vary(
        "computation",
        replace(DEFAULT, tets=FINEST),
        {
            "mesh of 139k, against 898k": {"tets": 145_000},
            "mesh of 221k (default), against 898k": {"tets": 225_000},
            "mesh of 488k, against 898k": {"tets": 500_000},
        },
    ),
    *_vary(
        "model",
        DEFAULT,
        {
            "the papers' way: spline and itmsm": vars(PAPERS),
            "spline instead of ribs that follow": vars(BENT),
            "itmsm instead of a continuum": {"energy": "itmsm"},
            "skin that does not resist bending": {"skin_rigidity": 0.0},
            "skin of 1.5 N mm instead of 0.4": {"skin_rigidity": 1.5},
            "nu 0.3 instead of 0.45": {"poisson_ratio": 0.3},
            "nu 0.4 instead of 0.45": {"poisson_ratio": 0.4},
            "nu 0.49 instead of 0.45": {"poisson_ratio": 0.49},
            "skin, fat, muscle": {"layers": True},
            "gravity, sag-free rest": {"gravity": G},
            "gravity, scan as rest": {"gravity": G, "rest": "scan"},
        },
    ),
    *_vary(
        "model",
        PAPERS,
        {
            "papers' way: continuum instead of itmsm": {"energy": "neo-hookean"},
            "papers' way: weights by volume": {"weights": "volume"},
            "papers' way: epsilon 0.1 instead of 1": {"epsilon": 0.1},
            "papers' way: epsilon 10 instead of 1": {"epsilon": 10.0},
            "papers' way: theta 1 instead of 10": {"theta": 1.0},
            "papers' way: theta 100 instead of 10": {"theta": 100.0},
            "papers' way: theta 1000 instead of 10": {"theta": 1000.0},
            "papers' way: skin, fat, muscle": {"layers": True},
        },
    ),
    *_vary(
        "computation",
        replace(PAPERS, tets=FINEST),
        {"papers' way: mesh of 221k, against 898k": {"tets": DEFAULT.tets}},
    ),
    *_vary(
        "computation",
        replace(BY_VOLUME, tets=FINEST),
        {"papers' way by volume: mesh of 221k, against 898k": {"tets": DEFAULT.tets}},
    ),
    *_vary(
        "model",
        replace(BENT, tets=FINEST),
        {
            "papers' way, against a continuum of 898k": vars(PAPERS),
            "papers' way by volume, against a continuum of 898k": vars(BY_VOLUME),
        },
    ),
]
"""What takes one run each."""


def rows(landmark_samples: int, bone_samples: int) -> list[Row]:
    """Every row."""
    size = f"{LANDMARK_MEAN} +- {LANDMARK_SD} mm"
    each, shared = (
        tuple(Choices(landmark_error=kind, sample=sample) for sample in range(landmark_samples))
        for kind in ("each", "shared")
    )
    bent = tuple(replace(PAPERS, landmark_error="each", sample=sample) for sample in range(landmark_samples))
    bones = tuple(Choices(bone_error=BONE_MEAN, sample=sample) for sample in range(bone_samples))
    return [
        *_VARIED,
        Row(f"landmarks off by {size}, before and after", "input", DEFAULT, each),
        Row("landmarks off likewise, BSR measured by them", "input", DEFAULT, each, measured_with_error=True),
        Row(f"landmarks off by {size}, the plan by the same", "input", DEFAULT, shared),
        Row("papers' way: landmarks off, before and after", "input", PAPERS, bent),
        Row(f"bones off by {BONE_MEAN} mm (meshed anew)", "input", DEFAULT, bones),
        Row("meshed anew (the noise of meshing)", "computation", DEFAULT, (replace(bones[0], bone_error=0.01),)),
    ]
