"""Checks the English of pages, docstrings, comments, messages and report, and names: proselint with our own style.

    uv run python scripts/check_prose.py            # status 1 and one line for each offence

Code in pages (fenced, or between backticks) is left out. `STYLE` holds the project's own rules; CONTRIBUTING.md
explains the words that it asks for.
"""

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

from proselint import checks as their_checks
from proselint.config import DEFAULT, Config
from proselint.registry import CheckRegistry
from proselint.registry.checks import Check
from proselint.registry.checks.types import PreferredForms
from proselint.tools import LintFile

ROOT = Path(__file__).parents[1]
STYLE = {
    r"tell|tells|telling|told": "report, state, show or distinguish",
    r"foretell|foretells|foretold": "predict or extrapolate",
    r"anew": "again",
    r"hangs? on|hanging on": "depends on",
    r"go by|goes by": "use or follow",
    r"nobody|of nobody": "no one, or synthetic",
    r"what is there|what there is": "name the thing",
    r"what is wrong": "the error",
    r"stead(?:y|ied|ying|ies)": "smooth",
    r"as one says (?:it|them)": "name the format",
    r"says? of|said of": "states about",
    r"the house|rooms? of": "architecture, package",
    r"mend(?:s|ed|ing)?": "repair",
    r"has? a say": "takes part",
    r"is too much": "unexpected argument",
    r"the seeds|seeds'": "itmsm for the energy, [1] and [2] for the papers",
    r"skin_actual|skin_after": "predicted_skin or actual_skin",
    r"unknown nodes": "free nodes",
    r"polish(?:es|ed|ing)?": "improve quality",
    r"steer(?:s|ed|ing)?": "the verb for what it does",
    r"preop|postop": "before, after",
    r"right-hand hump": "hump on the right",
}
"""Refused constructions, as regular expressions of whole words, and what to write instead."""
EMPTY_NAMES = {
    *(
        "found",
        "one",
        "ones",
        "there",
        "here",
        "known",
        "given",
        "kept",
        "others",
        "theirs",
        "thing",
        "things",
        "it",
    ),
    *("this", "that", "these", "those", "such"),
}
"""Names of variables, parameters, fields, functions and classes that state nothing of what they hold."""
BARE_CONSTANTS = {"STEP", "STEPS", "MOST", "LEAST", "FEW", "FEWEST", "AGAIN", "ENOUGH", "EACH", "SAME", "OTHER"}
"""Names of constants that lack a noun."""
LEFT_OUT = ("typography", "dates_times", "lexical_illusions", "misc.phrasal_adjectives", "misc.currency")
"""Checks of proselint that do not fit technical text in plain punctuation, tables and equations."""
ALLOWED = {
    "warp_trunk/case/header.py": "skin_after",
    "scripts/check_prose.py": "",
    "tests/case/test_folder.py": "skin_after",
    "tests/scripts/test_check_prose.py": "",
}
"""The word that a source needs: a name in a file of an earlier version; the empty word allows this file all."""
CODE = ("warp_trunk", "kernels", "scripts", "tests")
"""Folders whose docstrings, comments, messages and templates are checked."""
LEAST_WORDS = 3
"""A string of fewer words is a name, not prose."""


def main() -> int:
    """Prints every offence and returns the exit status."""
    offences = [f"{path.relative_to(ROOT)}:{line}" for path in sources() for line in check(path)]
    print("\n".join(offences) or "no offence")
    return bool(offences)


def sources() -> list[Path]:
    """The pages and sources whose English is checked."""
    pages = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
    code = [path for folder in CODE for path in (ROOT / folder).rglob("*") if path.suffix in (".py", ".html")]
    return [*pages, *sorted((ROOT / "docs").glob("*.md")), *sorted(code)]


def check(path: Path) -> Iterator[str]:
    """The offences of one file as line: message."""
    text = path.read_text(encoding="utf-8")
    prose = {".py": of_code, ".html": of_template, ".md": of_page}[path.suffix](text)
    allowed = ALLOWED.get(str(path.relative_to(ROOT)))
    code = [*noun_clauses(text), *empty_names(text)] if path.suffix == ".py" else []
    for line, message in [*offences(prose), *code]:
        if allowed is None or allowed not in message:
            yield f"{line}: {message}"


def offences(prose: str) -> list[tuple[int, str]]:
    """The number of each line with an offence, and the offence."""
    prose = re.sub(r"`[^`\n]*`", "", prose).encode(errors="replace").decode()
    results = LintFile("text", prose).lint(_config()) if prose.strip() else []
    return [(result.pos[0], result.check_result.message) for result in results]


def noun_clauses(text: str) -> list[tuple[int, str]]:
    """Docstrings of a source that begin with a noun clause, with their lines."""
    return [
        (node.lineno, "a docstring begins with 'What'; write a noun or a full sentence")
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if str(node.value.value).lstrip().startswith("What ")
    ]


def empty_names(text: str) -> list[tuple[int, str]]:
    """Names that a source gives and that are in `EMPTY_NAMES`, with their lines."""
    return [
        (getattr(node, "lineno", 1), f"'{name}' states nothing of what it holds; name the content")
        for node in ast.walk(ast.parse(text))
        if (name := _name_given(node)).strip("_").lower() in EMPTY_NAMES or name.strip("_") in BARE_CONSTANTS
    ]


def _name_given(node: ast.AST) -> str:
    match node:
        case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()) | ast.arg(arg=name):
            return name
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            return name
        case ast.alias(asname=str(name)) | ast.ExceptHandler(name=str(name)) | ast.MatchAs(name=str(name)):
            return name
    return ""


def of_page(text: str) -> str:
    """A page without code, equations and addresses, line by line where it was."""
    text = re.sub(r"^```.*?^```|\$\$.*?\$\$", _blank, text, flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"\]\([^)]*\)", "]", text)


def of_template(text: str) -> str:
    """The text of a template without tags and expressions, line by line where it was."""
    return re.sub(r"\{%.*?%\}|\{\{.*?\}\}|<style>.*?</style>|<[^>]*>", _blank, text, flags=re.DOTALL)


def of_code(text: str) -> str:
    """Docstrings, messages and comments of a source, line by line where they were."""
    pieces = [
        (node.lineno, node.value)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    pieces += [(token.start[0], token.string.lstrip("# ")) for token in tokens if token.type == tokenize.COMMENT]
    lines = [""] * (text.count("\n") + 2)
    for first, prose in pieces:
        if len(prose.split()) >= LEAST_WORDS:
            for number, line in enumerate(prose.splitlines(), first):
                lines[min(number, len(lines) - 1) - 1] += f" {line}"
    return "\n".join(lines)


def _blank(match: re.Match[str]) -> str:
    return " " + "\n" * match[0].count("\n")


def _config() -> Config:
    registry = CheckRegistry()
    if not registry.checks:
        own = PreferredForms({f"(?:{pattern})": instead for pattern, instead in STYLE.items()})
        registry.register_many(
            (*their_checks.__register__, Check(own, path="warp_trunk", message="'{1}': write {0}"))
        )
    checks = {**DEFAULT["checks"], "warp_trunk": True, **dict.fromkeys(LEFT_OUT, False)}
    return Config(max_errors=10_000, checks=dict(sorted(checks.items(), key=lambda item: -item[0].count("."))))


if __name__ == "__main__":
    sys.exit(main())
