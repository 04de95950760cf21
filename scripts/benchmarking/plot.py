"""The plot of error against time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from warp_trunk import InputError

from .outside import OUTSIDE
from .record import Record, Setting
from .tables import curves, method

COLOURS = {
    "newton": "#0072B2",
    "newton, neo-hookean": "#CC79A7",
    "newton, neo-hookean, follow": "#E69F00",
    "gradient": "#009E73",
    OUTSIDE: "#000000",
}
"""By method; of the palette of Okabe and Ito, distinct for colour-blind readers, and in grey by the marks."""
NAMES = {
    "newton": "Newton, papers' energy",
    "newton, neo-hookean": "Newton, neo-Hookean",
    "newton, neo-hookean, follow": "Newton, ribs that follow",
    "gradient": "spectral gradient",
    OUTSIDE: "SciPy L-BFGS-B",
}


def plot(path: str | Path, records: Sequence[Record], title: str = "") -> None:
    """Draws every curve, both axes logarithmic.

    Raises:
        InputError: matplotlib is not installed, or there is nothing to draw.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise InputError("plot: needs matplotlib; run with 'uv run --with matplotlib'") from error
    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    if not records:
        raise InputError("plot: there are no records to draw")
    by_setting = curves(records)
    figure, axes = plt.subplots(figsize=(8.0, 5.4), layout="constrained")
    for setting, points in by_setting.items():
        points = sorted(points, key=lambda point: point.seconds)  # times jitter where points lie close
        axes.loglog(
            [point.seconds for point in points],
            [point.max_error_mm for point in points],
            color=COLOURS[method(setting)],
            linestyle="-" if setting.precision == "float32" else "--",
            marker=_marker(setting),
            markersize=5.5,
            linewidth=1.4,
            markerfacecolor=COLOURS[method(setting)] if setting.precision == "float32" else "white",
        )
    _goal_lines(axes)
    axes.set_xlabel("time of the whole simulation after set-up [s]")
    axes.set_ylabel("largest error of a node [mm]")
    axes.set_title(title, loc="left", fontsize=11)
    axes.grid(which="major", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)

    figure.legend(handles=_legend(by_setting), loc="outside right upper", frameon=False, fontsize=9)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=160, facecolor="white")  # also on a dark page
    plt.close(figure)


def _legend(settings: Iterable[Setting]) -> list[Any]:
    """A line for each method, a mark for each device, and a line for each precision."""
    from matplotlib.lines import Line2D

    settings = list(settings)
    methods = dict.fromkeys(method(setting) for setting in settings)
    places = {_where(setting): _marker(setting) for setting in settings}
    precisions = dict.fromkeys(setting.precision for setting in settings)
    handles = [Line2D([], [], color=COLOURS[name], linewidth=3, label=NAMES[name]) for name in methods]
    handles += [
        Line2D([], [], color="#555555", linestyle="", marker=mark, label=where) for where, mark in places.items()
    ]
    handles += [
        Line2D(
            [],
            [],
            color="#555555",
            linestyle="-" if precision == "float32" else "--",
            marker="o",
            markerfacecolor="#555555" if precision == "float32" else "white",
            label=precision,
        )
        for precision in precisions
    ]
    return handles


def _goal_lines(axes: Any) -> None:
    for error, words in ((1.0, "1 mm"), (0.01, "0.01 mm, the default")):
        axes.axhline(error, color="#999999", linewidth=0.8, linestyle=":", zorder=0)
        axes.annotate(
            words,
            (1.0, error),
            xycoords=("axes fraction", "data"),
            xytext=(-2, 3),
            textcoords="offset points",
            ha="right",
            fontsize=8,
            color="#555555",
        )


def _where(setting: Setting) -> str:
    if setting.device != "cpu":
        return "CUDA"
    return f"CPU, {setting.threads} thread{'s' if setting.threads > 1 else ''}"


def _marker(setting: Setting) -> str:
    if setting.device != "cpu":
        return "^"
    return "o" if setting.threads == 1 else "s"
