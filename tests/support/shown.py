"""Outputs as lines of text, compared with the text that a person read and accepted.

A text of tests/shown holds every word of a picture, a recording or a page, every short array, and of long arrays
the size, the ends, the range and the mean. Who changes an output reads the difference and, if it is right, accepts
it by `WARP_TRUNK_ACCEPT=1 pytest -k as_accepted`.
"""

import difflib
import os
import re
from collections.abc import Iterable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import artist, collections, image, lines, patches, spines, text
from matplotlib.figure import Figure
from rerun.chunk import RrdReader

from support.drawn import Page
from warp_trunk.results.summary import PACKAGES

TEXTS = Path(__file__).parents[1] / "shown"
SHORT = 24
"""Arrays of at most as many numbers are written whole."""
CLOSE = 2e-3
"""Numbers agree within this part, or this."""
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w])")
KEY = re.compile(r"[0-9a-f]{8}-?(?:[0-9a-f]{4}-?){3}[0-9a-f]{12}")
"""A name that is drawn by lot."""


def check_shown(name: str, shown: Iterable[str]) -> None:
    """Compares lines with those of a text of tests/shown, words letter by letter and numbers within 0.2 %."""
    file, now = TEXTS / f"{name}.txt", [line.rstrip() for text in shown for line in text.splitlines()]
    if os.environ.get("WARP_TRUNK_ACCEPT"):
        file.write_text("\n".join(now) + "\n", encoding="utf-8", newline="\n")
    before = file.read_text(encoding="utf-8").splitlines()
    pairs = zip(before, now, strict=False)
    wanted = [new if _same(old, new) else old for old, new in pairs] + before[len(now) :]
    difference = list(difflib.unified_diff(wanted, now, "accepted", "now", lineterm="", n=1))
    assert not difference, "\n".join([f"{name} shows something else; see {Path(__file__).name}", *difference[:40]])


def _same(before: str, now: str) -> bool:
    if before == now:
        return True
    if NUMBER.split(before) != NUMBER.split(now):
        return False
    old, new = (np.array(NUMBER.findall(line), dtype=float) for line in (before, now))
    return bool(np.allclose(old, new, rtol=CLOSE, atol=CLOSE))


def described(value: Any) -> str:
    """A value as text; of a long array its shape, ends, range and mean along its first axis."""
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, str):
        return KEY.sub("#", value)
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {described(part)}" for key, part in value.items()) + "}"
    if isinstance(value, (list, tuple)) and not _numeric(value):
        return f"[{', '.join(map(described, value))}]"
    if value is None or isinstance(value, bool):
        return str(value)
    array = np.asarray(value)
    if array.dtype == bool:
        return f"{array.shape} true {int(array.sum())}"
    if array.dtype.kind not in "iuf":
        return str(value)
    array = array.astype(float)
    if array.size <= SHORT:
        return _rounded(array)
    rows = array.reshape(len(array), -1)[:, :4]
    weights = np.arange(1, len(rows) + 1) / len(rows)
    parts = {"ends": rows[[0, -1]], "least": rows.min(axis=0), "most": rows.max(axis=0)}
    parts |= {"mean": rows.mean(axis=0), "weighted": weights @ rows / len(rows)}
    return f"{array.shape} " + ", ".join(f"{name} {_rounded(part)}" for name, part in parts.items())


def _numeric(value: Any) -> bool:
    try:
        return np.asarray(value).dtype.kind in "iufb"
    except ValueError:  # rows of different lengths
        return False


def _rounded(array: np.ndarray) -> str:
    scale = float(np.abs(array[np.isfinite(array)]).max(initial=0.0))
    small = np.abs(array) < 1e-6 * max(scale, 1.0)
    words = np.vectorize("{:.5g}".format, otypes=[object])(np.where(small, 0.0, array)).tolist()
    return str(words).replace("'", "")


def recording_lines(path: Path) -> Iterator[str]:
    """The entities of a recording and its layout, each component at each step."""
    reader = RrdReader(path)
    for store in [*reader.recordings(), *reader.blueprints()]:
        rows = set[str]()
        for chunk in reader.stream(store=store):
            batch = chunk.to_record_batch()
            steps = batch.column("increment").to_pylist() if "increment" in batch.schema.names else []
            for name in batch.schema.names:
                if ":" not in name or name.endswith(("start_time", "_ids", "root_container")):
                    continue
                for row, value in enumerate(batch.column(name).to_pylist()):
                    if value is not None:
                        if name.endswith(("colors", "albedo_factor")):  # four bytes in one number
                            value = np.array(value, dtype=">u4").view(np.uint8).reshape(-1, 4)
                        when = f" at {steps[row]}" if steps else ""
                        rows.add(f"{described(chunk.entity_path)}{when} {name}: {described(value)}")
        yield f"== {store.kind}"
        yield from sorted(rows)


def figure_lines(name: str, figure: Figure) -> Iterator[str]:
    """Words, lines, areas and pictures of a figure, each at its place."""
    yield f"== {name}: {described(figure.get_size_inches())} inches"
    yield from _drawn(figure.texts)
    for axes in figure.axes:
        yield f"-- axes {described([axes.get_xlim(), axes.get_ylim()])}, aspect {axes.get_aspect()}"
        yield from (
            f"label {title!r}" for title in (axes.get_title(), axes.get_xlabel(), axes.get_ylabel()) if title
        )
        yield from _drawn(axes.get_children())
        if legend := axes.get_legend():
            yield f"legend {[entry.get_text() for entry in legend.get_texts()]}"


def _drawn(artists: Iterable[artist.Artist]) -> Iterator[str]:
    for part in artists:
        if not part.get_visible():
            continue
        if isinstance(part, text.Text) and part.get_text():
            aligned = f"{part.get_horizontalalignment()} {part.get_verticalalignment()}"
            where = f"{_frame(part)} {aligned} turned {part.get_rotation():g}"
            yield f"text {part.get_text()!r} at {described(part.get_position())} {where}"
        elif isinstance(part, lines.Line2D):
            style = f"{part.get_linestyle()} {part.get_marker()}"
            yield f"line {_label(part)} {style} {described(part.get_xydata())}"
        elif isinstance(part, patches.Patch) and not isinstance(part, spines.Spine):
            yield f"{type(part).__name__} {_label(part)} {described(part.get_path().vertices)}"
        elif isinstance(part, collections.Collection):
            ways = [path.vertices for path in part.get_paths()]
            corners = np.concatenate(ways) if ways else np.empty((0, 2))
            yield f"{type(part).__name__} of {len(ways)}: {described(corners)}, {described(part.get_offsets())}"
        elif isinstance(part, image.AxesImage):
            yield f"picture {described(part.get_extent())} {described(np.asarray(part.get_array()))}"


def _frame(part: artist.Artist) -> str:
    """The frame of the coordinates of an artist."""
    way, axes = part.get_transform(), part.axes
    if axes is None or way == axes.transData:
        return "of the data" if axes else "of the figure"
    return "of the axes" if way == axes.transAxes else "of another frame"


def _label(part: artist.Artist) -> str:
    """The name in the legend; others are numbered by the order of drawing."""
    label = str(part.get_label())
    return "" if label.startswith("_") else repr(label)


def page_lines(page: Page) -> Iterator[str]:
    """The sentences of a page and the rows of its tables."""
    yield from re.sub("Versions .* Seconds", "Versions, and Seconds", page.words).split(". ")
    rows = (" | ".join([title, *cells]) for title, cells in page.rows.items() if title not in PACKAGES)
    yield from (row for row in rows if not row.startswith(("python |", "platform |")))


def report_lines(page: Page, figures: dict[str, Figure]) -> Iterator[str]:
    """A page and its figures."""
    yield from page_lines(page)
    for name, figure in sorted(figures.items()):
        yield from figure_lines(name, figure)


def scene_lines(server: Any) -> Iterator[str]:
    """The objects in the picture of a live page, and its switches, lists and texts."""
    for name, handle in sorted(server.scene._handle_from_node_name.items()):
        own = handle._impl
        yield f"-- {name} {'shown' if own.visible else 'hidden'} {described(own.position)} {described(own.wxyz)}"
        yield _properties(own.props)
    containers = server.gui._container_handle_from_uuid.values()
    handles = [handle for container in containers for handle in container._children.values()]
    for handle in sorted(handles, key=lambda handle: float(handle._impl.props.order)):
        yield f"-- {type(handle).__name__} {described(getattr(handle, 'value', None))}"
        yield _properties(handle._impl.props)


def _properties(record: Any) -> str:
    return "; ".join(f"{name} {described(value)}" for name, value in vars(record).items() if name != "order")
