"""Figures of a report as they are drawn, before they become pixels, and pages as a reader sees them."""

import base64
import re
from collections.abc import Iterator
from contextlib import contextmanager
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from warp_trunk.report import skin_pictures
from warp_trunk.views.relief import BEHIND

PIXEL = base64.b64decode(
    b"iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGP4//8/AAX+Av4N70a4AAAAAElFTkSuQmCC"
)
"""A picture of one pixel: drawing all of them takes most of the time of a report."""


@contextmanager
def drawn_figures() -> Iterator[dict[str, Any]]:
    """The figures that are written as PNG meanwhile, by the names of their files, "" for one alone; no pixels are
    drawn."""
    figures: dict[str, Any] = {}

    def save(figure: Figure, file: Any, *, format: str, metadata: dict[str, Any], **_: Any) -> None:
        if format == "png":
            figures[(metadata["Source"] or "").rpartition(" ")[2]] = figure
        file.write(PIXEL if format == "png" else b"<svg/>")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", save)
        patch.setattr(skin_pictures, "FINE", 2.0)  # pixels take most of the time that is left
        patch.setattr(skin_pictures.looks, "__defaults__", (BEHIND, 2.0, "shorts"))
        yield figures


def pixels(axes: Any) -> np.ndarray:
    """The picture of a panel: red, green, blue and opacity, from 0 to 1, shape (rows, columns, 4)."""
    image = np.array(axes.images[0].get_array())
    return image / 255.0 if image.dtype == np.uint8 else np.nan_to_num(image)


def place(axes: Any, x: float, y: float) -> tuple[float, float]:
    """Where a point of the data is on the page: 0 to 1 from left to right, and from bottom to top."""
    across, up = axes.transLimits.transform((x, y))
    return float(across), float(up)


def side_at(axes: Any, across: float) -> str:
    """The side of the patient that is written at the edge of a panel which is nearer to a place."""
    words = {
        text.get_position()[0]: text.get_text() for text in axes.texts if text.get_text() in ("left", "right")
    }
    return words[float(round(across))]


def slope_on_page(axes: Any, ends: np.ndarray) -> float:
    """Slope of a line (2, 2) on the page [degrees], positive where it falls from left to right."""
    ways = [np.sign(high - low) for low, high in (axes.get_xlim(), axes.get_ylim())]
    (x, y), (u, v) = sorted((ends * ways).tolist())
    return float(np.degrees(np.arctan2(y - v, u - x)))


class Page(HTMLParser):
    """The words of a page that a reader sees or hears, the rows of its tables by first cell, and its data."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words, self.rows, self.scripts = "", dict[str, list[str]](), list[str]()
        self._cells, self._hidden = list[str](), False
        self.feed(text)
        self.words = " ".join(self.words.split())

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self._hidden = self._hidden or tag in ("script", "style")
        if "type" in dict(attrs) and tag == "script":
            self.scripts.append("")
        self.words += f" [{dict(attrs)['alt']}]" if tag == "img" else ""
        if tag == "tr":
            self._cells = []
        elif tag in ("td", "th"):
            self._cells.append("")
        self.words += " "

    def handle_endtag(self, tag: str) -> None:
        self._hidden = self._hidden and tag not in ("script", "style")
        if tag == "tr" and self._cells:
            title, *cells = (re.sub(r"\s+", " ", cell).strip() for cell in self._cells)
            self.rows.setdefault(title, cells)
            self._cells = []

    def handle_data(self, data: str) -> None:
        if self._hidden and self.scripts and not self.scripts[-1]:
            self.scripts[-1] = data
        if not self._hidden:
            self.words += data
            if self._cells:
                self._cells[-1] += data
