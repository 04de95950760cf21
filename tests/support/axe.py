"""Faults that axe-core reports of a page: names of controls, contrasts, order of headings."""

import importlib.util
from pathlib import Path
from typing import Any

from playwright.sync_api import Page

_PACKAGE = importlib.util.find_spec("axe_playwright_python")
assert _PACKAGE is not None
assert _PACKAGE.origin is not None
SCRIPT = Path(_PACKAGE.origin).with_name("axe.min.js").read_text(encoding="utf-8")
"""Read here, because the package reads it in the encoding of the system."""


def violations(tab: Page, *rules: str) -> list[tuple[str, str]]:
    """Rules that the page breaks, each with the first element that does; of all rules without `rules`."""
    tab.evaluate(SCRIPT)
    options: dict[str, Any] = {"resultTypes": ["violations"]} | ({"runOnly": list(rules)} if rules else {})
    broken = tab.evaluate("options => axe.run(options).then(seen => seen.violations)", options)
    return [(rule["id"], rule["nodes"][0]["html"][:100]) for rule in broken]
