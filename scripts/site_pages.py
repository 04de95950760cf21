"""Pages made from the program, and equations as MathML, for MkDocs; `mkdocs.yml` names this file as a hook.

Browsers render MathML themselves, so that a reader of the site fetches nothing from elsewhere.
"""

import html
import re

import latex2mathml.converter
import reference_pages
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

MATH = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
"""An equation as `pymdownx.arithmatex` leaves it: between \\( and \\), or between \\[ and \\]."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages of commands and of Python."""
    made = {"commands.md": reference_pages.commands_page(), "api.md": reference_pages.python_page()}
    for name, page in made.items():
        files.append(File.generated(config, name, content=page))
    return files


def on_page_markdown(markdown: str, **_: object) -> str:
    """Fills the tables of records."""
    return reference_pages.filled(markdown)


def on_page_content(content: str, **_: object) -> str:
    """Replaces each equation of a page by MathML."""
    return MATH.sub(_mathml, content)


def _mathml(equation: re.Match[str]) -> str:
    display = "block" if equation[2] == "[" else "inline"
    converted = latex2mathml.converter.convert(html.unescape(equation[3]).strip(), display=display)
    if "\\" in converted:
        raise ValueError(f"latex2mathml does not know a command of {equation[3]!r}; write it otherwise")
    return converted
