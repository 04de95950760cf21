"""Tables in Markdown."""

from collections.abc import Iterable, Sequence
from dataclasses import fields

from warp_trunk import InputError

from .outside import OUTSIDE
from .record import Record, Setting

LEVELS = (1.0, 0.1, 0.01)
"""Errors that a curve is asked for the time of [mm]."""
ENERGIES = {"itmsm": "papers'", "neo-hookean": "neo-Hookean"}
METHODS = {OUTSIDE: "SciPy L-BFGS-B"}


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; the first column is text, the others are numbers."""
    lines = ["| " + " | ".join(header) + " |", "|---|" + "---:|" * (len(header) - 1)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def setting_of(record: Record) -> Setting:
    """The curve a record belongs to."""
    return Setting(**{field.name: getattr(record, field.name) for field in fields(Setting)})


def curves(records: Iterable[Record]) -> dict[Setting, list[Record]]:
    """Records by curve, in the order they come.

    Raises:
        InputError: a curve with points of two machines or two meshes.
    """
    by_setting: dict[Setting, list[Record]] = {}
    for record in records:
        points = by_setting.setdefault(setting_of(record), [])
        points.append(record)
        for name in ("hardware", "tets"):
            first, value = getattr(points[0], name), getattr(record, name)
            if value != first:
                raise InputError(
                    f"records: {record.method} on {record.device} has '{name}' {first} and {value}; "
                    "show them one by one"
                )
    return by_setting


def latest(files: Iterable[Iterable[Record]]) -> list[Record]:
    """The records of all files; a curve that a later file has again stands in the place of the earlier one."""
    by_curve: dict[Setting, list[Record]] = {}
    for records in files:
        by_curve.update(curves(records))
    return [record for points in by_curve.values() for record in points]


def seconds_to(points: Iterable[Record], error: float) -> float | None:
    """The least time in which a curve has a node error of at most `error` [mm]; None if it never does."""
    return min((point.seconds for point in points if point.max_error_mm <= error), default=None)


def short_table(records: Iterable[Record]) -> str:
    """For every curve: seconds to each of LEVELS; its last point, where it did not come to the last of them."""
    rows = []
    for setting, points in curves(records).items():
        reached = [seconds_to(points, level) for level in LEVELS]
        end = points[-1]
        rows.append(
            [
                METHODS.get(setting.method, setting.method),
                setting.bones,
                ENERGIES[setting.energy],
                f"{setting.threads} thread{'s' * (setting.threads > 1)}"
                if setting.device == "cpu"
                else end.hardware,
                setting.precision,
                *("" if seconds is None else number(seconds) for seconds in reached),
                f"{number(end.max_error_mm)} mm after {number(end.seconds)} s" if reached[-1] is None else "",
            ]
        )
    header = ["method", "bones", "energy", "where", "precision", *(f"to {level:g} mm [s]" for level in LEVELS)]
    return markdown([*header, "left at the end"], rows)


BEGIN, END = "<!-- begin benchmark: written by a script -->", "<!-- end benchmark -->"
"""Lines of a page before and after the table."""


def replaced(page: str, table: str) -> str:
    """The page with the table between its marks.

    Raises:
        ValueError: the marks are not there, once each and in their order.
    """
    if page.count(BEGIN) != 1 or page.count(END) != 1 or page.index(BEGIN) > page.index(END):
        raise ValueError(f"the page needs the lines '{BEGIN}' and '{END}', once each and in this order")
    return f"{page.split(BEGIN)[0]}{BEGIN}\n\n{table.strip()}\n\n{END}{page.split(END)[1]}"


def number(value: float) -> str:
    """Three digits, without an exponent where it reads well."""
    if value == 0.0:
        return "0"
    if 1e-3 <= abs(value) < 1000.0:
        digits = f"{value:.3g}"
        return digits if "e" not in digits else f"{value:.0f}"
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.1e}"
