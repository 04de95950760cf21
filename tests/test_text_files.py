"""Text is read and written in UTF-8 with `\\n` on every system."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

TREE = Path(__file__).parents[1]
_SOURCES = ("warp_trunk", "kernels", "scripts")


def unstated(code: str) -> list[str]:
    """The calls that read or write text and leave its encoding, or the ends of its lines, to the system."""
    calls: list[str] = []
    for node in ast.walk(ast.parse(code)):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        stated = {word.arg: ast.unparse(word.value) for word in node.keywords}
        texts = [argument.value for argument in node.args if isinstance(argument, ast.Constant)]
        mode = next((text for text in texts if text in ("w", "a", "x")), None) if name == "open" else None
        writes = name == "write_text" or mode is not None
        reads = name == "read_text" and not node.args
        if (
            ((reads or writes) and stated.get("encoding") not in ("'utf-8'", "'utf-8-sig'"))
            or (writes and stated.get("newline") is None)
            or stated.get("text") == "True"
            or "universal_newlines" in stated
        ):
            calls.append(ast.unparse(node))
    return calls


def test_no_text_is_left_to_the_system() -> None:
    for folder in _SOURCES:
        for path in (TREE / folder).rglob("*.py"):
            assert unstated(path.read_text(encoding="utf-8")) == [], path


@pytest.mark.parametrize(
    ("code", "count"),
    [
        ("p.read_text()", 1),
        ("p.read_text(encoding='utf-8')", 0),
        ("p.write_text('a', encoding='utf-8')", 1),
        ("p.write_text('a', encoding='utf-8', newline='')", 0),
        ("p.open('w')", 1),
        ("open(p, 'a', encoding='ascii', newline='')", 1),
        ("p.open('wb')", 0),
        ("run(c, text=True)", 1),
    ],
)
def test_text_left_to_the_system_is_found(code: str, count: int) -> None:
    assert len(unstated(code)) == count
