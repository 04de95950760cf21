"""Reference pages made from the program."""

from pathlib import Path

import pytest
import reference_pages

from warp_trunk.cli.commands import COMMANDS

DOCS = reference_pages.DOCS
MADE = [path for path in sorted(DOCS.glob("*.md")) if "<!-- made from" in path.read_text(encoding="utf-8")]


@pytest.mark.parametrize("path", MADE, ids=lambda path: path.name)
def test_a_page_is_that_of_the_program_as_it_is(path: Path) -> None:
    page = path.read_text(encoding="utf-8")
    assert page.count("<!-- made from") == page.count("<!-- end of") == len(reference_pages.BLOCK.findall(page))
    assert reference_pages.renewed(page) == page, "run python scripts/reference_pages.py"


def test_every_command_and_every_public_name_has_a_block() -> None:
    import warp_trunk

    commands, names = ((DOCS / page).read_text() for page in ("commands.md", "api.md"))
    assert [name for name in COMMANDS if f"<!-- made from warp-trunk {name} -->" not in commands] == []
    assert [name for name in warp_trunk.__all__ if f".{name} -->" not in names] == []


def test_sections_and_examples_of_a_docstring_are_lists_and_code() -> None:
    def read(path: str) -> str:
        """Read a file.

        >>> read("a")
        'b'

        Args:
            path: of the file,
                which exists.

        Raises:
            OSError: it does not.
        """
        return path

    text = reference_pages.described("read", read)
    assert "```python\nread(path: str) -> str\n```" in text
    assert "```pycon\n>>> read(\"a\")\n'b'\n```" in text
    assert "**Args**\n\n- `path`: of the file, which exists.\n" in text
    assert "- `OSError`: it does not." in text
