"""The error budget: each row measured, and the table of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from benchmarking.tables import markdown, number

from .difference import difference
from .rows import Group, Row
from .study import Study


@dataclass(frozen=True)
class Cost:
    """What one row costs; of several samples the mean."""

    label: str
    """What is varied."""
    group: Group
    """Whose error it is."""
    mean_mm: float
    """Mean distance over the back [mm]."""
    max_mm: float
    """Largest distance on the back [mm]."""
    bsr_deg: float
    """Largest difference of the back surface rotation of a level [degrees]."""
    samples: int
    """How many runs these are means of."""
    spread: dict[str, dict[str, float]]
    """Of each of the three, standard deviation and 95th percentile over the samples; empty for one sample."""
    level: str
    """Level of the largest difference of the rotation; of the sample where it is largest."""
    statuses: dict[str, int]
    """How many runs ended how."""
    inverted: int
    """Most tetrahedra without positive volume at the end of a run."""


def measured(study: Study, row: Row) -> Cost:
    """Runs a row, where it is not kept, and compares it."""
    print(row.label, flush=True)
    reference = study.ending(row.against)
    endings = [study.ending(choices) for choices in row.runs]
    after = study.case.planned_landmarks
    away = [
        difference(
            ending.skin,
            reference.skin,
            after,
            study.landmarks(choices)[1] if row.measured_with_error else None,
        )
        for choices, ending in zip(row.runs, endings, strict=True)
    ]
    statuses = [ending.status for ending in endings]
    values = {name: np.array([getattr(one, name) for one in away]) for name in ("mean_mm", "max_mm", "bsr_deg")}
    return Cost(
        label=row.label,
        group=row.group,
        **{name: float(of_samples.mean()) for name, of_samples in values.items()},
        samples=len(away),
        spread={name: _spread(of_samples) for name, of_samples in values.items()} if len(away) > 1 else {},
        level=max(away, key=lambda one: one.bsr_deg).level,
        statuses={status: statuses.count(status) for status in sorted(set(statuses))},
        inverted=max(ending.inverted for ending in endings),
    )


def _spread(values: np.ndarray) -> dict[str, float]:
    return {"sd": float(values.std(ddof=1)), "p95": float(np.quantile(values, 0.95))}


def table(costs: Sequence[Cost]) -> str:
    """All rows as Markdown."""
    rows = [
        [
            cost.label,
            _cell(cost, "mean_mm"),
            _cell(cost, "max_mm"),
            _cell(cost, "bsr_deg"),
            cost.level,
            ", ".join(
                f"{count} {status}" if cost.samples > 1 else status for status, count in cost.statuses.items()
            ),
        ]
        for cost in costs
    ]
    return markdown(["what", "back, mean [mm]", "max [mm]", "BSR, max [degrees]", "at", "ends"], rows)


def _cell(cost: Cost, name: str) -> str:
    """A number; of samples their mean, standard deviation and 95th percentile."""
    value: float = getattr(cost, name)
    if cost.samples == 1:
        return _digits(value)
    spread = cost.spread[name]
    return f"{_digits(value)} +- {_digits(spread['sd'])} (95 %: {_digits(spread['p95'])})"


def _digits(value: float) -> str:
    """Two digits."""
    return number(float(f"{value:.2g}"))
