"""Outputs as lines of text, compared with the text that a person read and accepted.

A text of tests/shown holds every word of a picture, a recording or a page, every short array, and of long arrays
the size, the ends, the range and the mean. Who changes an output reads the difference and, if it is right, accepts
it by `WARP_TRUNK_ACCEPT=1 pytest -k as_accepted`.
"""

import base64
import difflib
import json
import os
import re
import zlib
from collections.abc import Collection, Iterable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import artist, collections, contour, image, lines, patches, spines, text
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
VISER = {"order", "font_size_mode", "font_scene_height", "depth_test", "thickness_units", "wireframe"}
"""Properties that viser gives to every object or control."""


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
    rows = array.reshape(len(array), -1)[:, :6]
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        return f"{array.shape} without a number"
    weights = np.arange(1, len(rows) + 1) / len(rows)
    parts = {"ends": rows[[0, -1]], "least": rows.min(axis=0), "most": rows.max(axis=0)}
    parts |= {"mean": rows.mean(axis=0), "weighted": weights @ rows / len(rows)}
    return f"{array.shape} " + ", ".join(f"{name} {_rounded(part)}" for name, part in parts.items())


def _numeric(value: Any) -> bool:
    try:
        return np.asarray(value).dtype.kind in "iufb"
    except ValueError:  # rows of different lengths
        return False


def _rounded(array: np.ndarray, digits: int = 5) -> str:
    scale = float(np.abs(array[np.isfinite(array)]).max(initial=0.0))
    small = np.abs(array) < 1e-6 * max(scale, 1.0)
    words = np.vectorize(f"{{:.{digits}g}}".format, otypes=[object])(np.where(small, 0.0, array)).tolist()
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
                        when = " always" if chunk.is_static else f" at {steps[row]}" if steps else ""
                        rows.add(f"{described(chunk.entity_path)}{when} {name}: {described(value)}")
        yield f"== {store.kind}"
        yield from sorted(rows)


def figure_lines(name: str, figure: Figure) -> Iterator[str]:
    """Words, lines, areas and pictures of a figure, each at its place."""
    yield f"== {name}: {described(figure.get_size_inches())} inches"
    yield from _drawn(figure.texts)
    for axes in figure.axes:
        box = axes.get_position().bounds if figure.get_layout_engine() is None else "laid out"
        ends = described([axes.get_xlim(), axes.get_ylim()])
        yield f"-- axes in {described(box)} from {ends}, aspect {axes.get_aspect()}"
        yield from (f"label {title!r}" for title in (axes.get_xlabel(), axes.get_ylabel()) if title)
        yield from _drawn(part for part in axes.get_children() if part is not axes.patch)
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
            levels = ""
            if isinstance(part, contour.ContourSet):
                styles: Any = part.get_linestyle()
                dashed = "dashed" if any(dashes for _, dashes in styles) else "solid"
                levels = f" {dashed} at {described(part.levels)}"
            places = part.get_offsets() if np.any(part.get_offsets()) else ""
            yield f"{type(part).__name__}{levels} of {len(ways)}: {described(corners)} {described(places)}"
        elif isinstance(part, image.AxesImage):
            pixels = np.asarray(part.get_array(), dtype=float)
            blocks = [np.array_split(rows, 4, axis=1) for rows in np.array_split(pixels, 6)]
            means = [[block.mean(axis=(0, 1)).tolist() for block in row] for row in blocks]
            yield f"picture of {pixels.shape} in {described(part.get_extent())}, colours from the top:"
            yield from (f"  {_rounded(np.array(row), 4)}" for row in means)


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
    """The sentences of a page, the rows of its tables, and the trunk to turn."""
    yield from re.sub("Versions .* Seconds", "Versions, and Seconds", page.words).split(". ")
    rows = (" | ".join([title, *cells]) for title, cells in page.rows.items() if title not in PACKAGES)
    yield from (row for row in rows if not row.startswith(("python |", "platform |")))
    info, *data = page.scripts or ["{}"]
    if trunk := json.loads(info):
        yield from _turning(trunk, zlib.decompress(base64.b64decode(data[0])))


def _turning(info: dict[str, Any], data: bytes) -> Iterator[str]:
    """The states of a trunk to turn, each column of numbers as `turning.js` reads it."""
    yield f"== the trunk to turn: {described(info)}"
    skin, cloth, states = info["vertices"], info["cloth"], len(info["states"])
    columns = [3 * info["faces"]] * 2 + [skin] * 3 * states + [3 * info["clothFaces"]] * 2 + [cloth] * 3 * states
    columns += [skin] * 2 * states
    columns += [(len(data) - 2 * sum(columns) - 2 * skin * (3 * info["coloured"] + info["invented"])) // 2]
    for count in [*columns, *[skin] * (3 * info["coloured"] + info["invented"])]:
        low, high = np.frombuffer(data[: 2 * count], np.uint8).reshape(2, count).astype(np.int64)
        folded, data = low | high << 8, data[2 * count :]
        numbers = np.cumsum(folded >> 1 ^ -(folded & 1)).astype(np.int16)
        yield described(numbers)


def report_lines(page: Page, figures: dict[str, Figure]) -> Iterator[str]:
    """A page and its figures."""
    yield from page_lines(page)
    for name, figure in sorted(figures.items()):
        yield from figure_lines(name, figure)


def scene_lines(server: Any) -> Iterator[str]:
    """How a live page looks at first, the objects in its picture, and its switches, lists and texts."""
    for message in server._websock_server._broadcast_buffer.message_from_id.values():
        if type(message).__name__.startswith(("Theme", "EnableLights", "SetCamera", "SetGuiPanelLabel")):
            yield f"-- {type(message).__name__} {_properties(message)}"
    for name, handle in sorted(server.scene._handle_from_node_name.items()):
        own = handle._impl
        if "axes_length" not in vars(own.props):
            where = f"{described(own.position)} {described(own.wxyz)}"
            yield f"-- {name} {'shown' if own.visible else 'hidden'} {where} {_properties(own.props)}"
    containers = server.gui._container_handle_from_uuid.values()
    handles = [handle for container in containers for handle in container._children.values()]
    for handle in sorted(handles, key=lambda handle: float(handle._impl.props.order)):
        value = described(getattr(handle, "value", None))
        yield f"-- {type(handle).__name__} {value} {_properties(handle._impl.props)}"


def _properties(record: Any) -> str:
    """The properties of a record that say something of it."""
    parts = vars(record).items()
    return "; ".join(f"{name} {described(value)}" for name, value in parts if name[0] != "_" and name not in VISER)


def record_lines(value: Any, name: str, without: Collection[str] = ()) -> Iterator[str]:
    """The entries of a record of JSON but for some by their names, a row of a table in a line."""
    if isinstance(value, dict) and not all(isinstance(part, (int, float)) for part in value.values()):
        for key in (key for key in value if key not in without):
            yield from record_lines(value[key], f"{name}.{key}", without)
    elif isinstance(value, list) and any(isinstance(part, dict) for part in value):
        for number, part in enumerate(value):
            if any(isinstance(each, (dict, list)) for each in part.values()):
                yield from record_lines(part, f"{name} {number}", without)
            else:
                yield f"{name} {' '.join(map(described, part.values()))}"
    else:
        yield f"{name}: {described(value)}"
