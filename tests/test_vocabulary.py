"""The words of CONTRIBUTING are those of code, help and docs; the picture of the rooms is that of the code."""

import contextlib
import re
from pathlib import Path

import draw_architecture
import pytest

from warp_trunk.cli import main
from warp_trunk.cli.commands import COMMANDS

ROOT = Path(__file__).parents[1]
BANNED = {
    r"\bthe seeds\b|\bseeds'": "itmsm for the energy, [1] and [2] for the papers",
    r"\bskin_after\b(?!\")|\bskin_actual\b": "predicted_skin or actual_skin",
    r"\bunknown nodes\b": "free nodes",
    r"\bpolish(es|ed|ing)?\b": "improve quality",
    r"\bsteer(s|ed|ing)?\b": "the verb for what it does",
    r"\bpreop\b|\bpostop\b": "before, after",
    r"\bright-hand hump\b": "hump on the right",
    r":[<>^]?\+\d*\.\df": "z after the sign: a number that rounds to 0 is never -0",
}
"""What is not written, as a pattern, and what is written instead."""
ALLOWED = {"warp_trunk/case/header.py": "skin_after"}
"""Names that a file of an earlier version holds, by the source that reads them."""


def sources():
    code = [path for folder in ("warp_trunk", "kernels", "scripts") for path in (ROOT / folder).rglob("*.py")]
    return [*code, *(ROOT / "docs").glob("*.md"), ROOT / "README.md", ROOT / "warp_trunk" / "report" / "page.html"]


def offences(name: str, text: str) -> list[str]:
    """Every banned word of a text with its line, and the word to write instead."""
    return [
        f"{name}:{number}: {found[0]!r}; write {instead}"
        for number, line in enumerate(text.splitlines(), 1)
        for pattern, instead in BANNED.items()
        for found in re.finditer(pattern, line, re.IGNORECASE)
        if not found[0].startswith(ALLOWED.get(name, "\0"))
    ]


def test_a_banned_word_is_found():
    assert offences("a", "fine\nthe seeds' energy") == [
        "a:2: 'the seeds'; write itmsm for the energy, [1] and [2] for the papers"
    ]
    assert offences("a", "random seeds and a seedling") == []


def test_no_banned_word_stands_in_code_or_documentation():
    paths = sources()
    assert len(paths) > 200
    found = [line for path in paths for line in offences(str(path.relative_to(ROOT)), path.read_text())]
    assert found == []


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_no_banned_word_stands_in_help(command, capsys):
    with contextlib.suppress(SystemExit):
        assert main([*command.split(), "--help"]) == 0
    said = capsys.readouterr().out
    assert "usage" in said
    assert offences("help", said) == []


def test_documentation_names_no_folder_of_a_machine():
    for path in [*(ROOT / "docs").glob("*.md"), ROOT / "README.md"]:
        assert not re.search(r"(?<![\w.])/(work|tmp|home|root|Users)/", path.read_text()), path


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text().split()) <= 1300


def test_picture_of_the_rooms_is_that_of_the_code():
    """Where it fails: python scripts/draw_architecture.py."""
    drawn = draw_architecture.OUT.read_text(encoding="utf-8")
    assert drawn == draw_architecture.drawing(draw_architecture.arrows())


def test_rooms_in_a_circle_stand_side_by_side_and_above_what_they_import():
    edges = draw_architecture.Counter({("a", "b"): 1, ("b", "c"): 1, ("c", "b"): 2, ("c", "d"): 1})
    assert draw_architecture.floors(edges) == [["d"], ["b", "c"], ["a"]]
