"""Reference pages made from the program."""

from dataclasses import fields
from pathlib import Path

import reference_pages

import warp_trunk
from warp_trunk.case.uncertainty import REFERENCES, Uncertainty
from warp_trunk.cli.commands import COMMANDS

ROOT = Path(__file__).parents[2]


def test_every_command_and_every_public_name_has_a_part() -> None:
    commands, names = reference_pages.commands_page(), reference_pages.python_page()
    assert [name for name in COMMANDS if f"\nusage: warp-trunk {name} [" not in commands] == []
    assert [name for name in warp_trunk.__all__ if f"\n### {name}\n" not in names] == []


def test_fields_of_a_record_become_a_table() -> None:
    page = reference_pages.filled("Above.\n\n<!-- fields of warp_trunk.measures.quantities.Measured -->\n\nBelow.")
    assert page.startswith("Above.\n\n| entry | meaning | type |\n")
    assert "\n| `level` |" in page


def test_sources_of_error_have_their_default_and_its_origin() -> None:
    page = reference_pages.filled((ROOT / "docs" / "how_sure.md").read_text(encoding="utf-8"))
    for field in fields(Uncertainty):
        (row,) = (line.split(" | ") for line in page.splitlines() if line.startswith(f"| `{field.name}` |"))
        assert float(row[2]) == getattr(Uncertainty(), field.name)
        assert any(field.name.startswith(key) and text in row[3] for key, text in REFERENCES.items())


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
