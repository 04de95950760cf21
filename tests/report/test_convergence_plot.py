"""The plot of the estimated error: no label of it stands where the curve runs."""

from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.text import Annotation

from support.report_results import write_small_result
from warp_trunk.report.plots import convergence_plot
from warp_trunk.results.result import read_result


@pytest.mark.parametrize(
    ("increments", "labels"), [(1, ["at the end"]), (2, ["at the end", "before the last increment"])]
)
def test_tolerances_stand_beside_the_axes(tmp_path: Path, increments: int, labels: list[str]) -> None:
    summary = read_result(write_small_result(tmp_path)).summary
    figure = convergence_plot(replace(summary, increments=summary.increments[:increments]))
    figure.draw_without_rendering()
    axes = figure.axes[0]
    found = [text for text in axes.texts if isinstance(text, Annotation)]
    told = [" ".join(text.get_text().split()) for text in found]
    assert told == [
        f"tolerance {label}, {limit} mm" for label, limit in zip(labels, ("0.01", "0.2"), strict=False)
    ]
    places = [text.get_window_extent() for text in found]
    assert all(
        not place.overlaps(axes.get_window_extent()) and figure.bbox.contains(*place.p1) for place in places
    )
    assert not any(place.overlaps(other) for place in places for other in places if other is not place)
