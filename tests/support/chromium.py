"""A page opened in headless Chromium, and what it said and asked for."""

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import ConsoleMessage, sync_playwright

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="Chromium is not installed (on Debian: apt-get install chromium)"
)
QUIET = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip
WEBGL = (
    *(flag for flag in QUIET if flag != "--disable-gpu"),
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-webgl", "--ignore-gpu-blocklist",
)  # fmt: skip
"""The same with WebGL, drawn by the processor."""


@dataclass(frozen=True)
class Opened:
    """Record of an open page."""

    complaints: list[str]
    """Console messages of warning or error, and errors of scripts."""
    requests: list[str]
    """Addresses it asked for, without those inside the page (data:)."""
    pictures: list[dict[str, Any]]
    """Of every picture: complete, width and height [pixels], and how many different colours it shows."""
    overflow: dict[int, int]
    """By width of the window: how much wider the page is [pixels]."""
    words: str
    """The text that can be read."""
    printed: bytes
    """The page as PDF."""


_PICTURES = """
async () => Promise.all([...document.querySelectorAll('img')].map(async image => {
  await image.decode();
  const canvas = new OffscreenCanvas(200, 200), drawing = canvas.getContext('2d');
  drawing.drawImage(image, 0, 0, 200, 200);
  const pixels = new Uint32Array(drawing.getImageData(0, 0, 200, 200).data.buffer);
  return {complete: image.complete, width: image.naturalWidth, height: image.naturalHeight,
          shown: image.getBoundingClientRect().width, colours: new Set(pixels).size};
}))
"""


def _complains(said: ConsoleMessage) -> bool:
    """Whether a message is a warning or an error of the page, and not of the software that draws WebGL."""
    return said.type in ("error", "warning") and "GL Driver Message" not in said.text


def open_page(page_file: Path, widths: tuple[int, ...] = (1280, 400)) -> Opened:
    """Open a page from disk at several widths, without a network, and print it on A4."""
    complaints, requests, overflow = [], [], {}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(QUIET))
        page = browser.new_context(offline=True).new_page()
        page.on("console", lambda said: complaints.extend([said.text] * _complains(said)))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        for width in widths:
            page.set_viewport_size({"width": width, "height": 900})
            page.goto(page_file.resolve().as_uri(), wait_until="load")
            page_width = page.evaluate("document.documentElement.scrollWidth")
            overflow[width] = page_width - width
        fetched = [url for url in requests if not url.startswith("data:")]
        opened = Opened(
            complaints, fetched, page.evaluate(_PICTURES), overflow, page.inner_text("body"),
            page.pdf(prefer_css_page_size=True),
        )  # fmt: skip
        browser.close()
    return opened
