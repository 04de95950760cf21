"""Equations of the pages as MathML, for MkDocs; `mkdocs.yml` names this file as a hook.

Browsers render MathML themselves, so that a reader of the site fetches nothing from elsewhere.
"""

import html
import re

import latex2mathml.converter

MATH = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
"""An equation as `pymdownx.arithmatex` leaves it: between \\( and \\), or between \\[ and \\]."""


def on_page_content(content: str, **_: object) -> str:
    """Replaces each equation of a page by MathML."""
    return MATH.sub(_mathml, content)


def _mathml(equation: re.Match[str]) -> str:
    display = "block" if equation[2] == "[" else "inline"
    converted = latex2mathml.converter.convert(html.unescape(equation[3]).strip(), display=display)
    if "\\" in converted:
        raise ValueError(f"latex2mathml does not know a command of {equation[3]!r}; write it otherwise")
    return converted
