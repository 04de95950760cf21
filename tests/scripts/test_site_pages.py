"""Pages of the site that are made from the program."""

from pathlib import Path

import pytest

pytest.importorskip("latex2mathml", reason="the dependency group docs is not installed")
import site_pages  # after the check

ROOT = Path(__file__).parents[2]


def test_fields_of_a_record_become_a_table() -> None:
    table = site_pages.fields_of("StepSummary", ROOT / "warp_trunk" / "results" / "summary.py").splitlines()
    assert table[0] == "| entry | meaning | type |"
    assert any(row.startswith("| `seconds` | ") and row.endswith(" | float |") for row in table)


def test_help_of_a_command_replaces_its_line() -> None:
    page = site_pages.on_page_markdown(f"before\n{site_pages.HELP}\nafter")
    assert "## simulate\n\n```text\nusage: warp-trunk simulate" in page
    assert "--tets" in page


def test_equation_becomes_mathml() -> None:
    page = site_pages.on_page_content(r'<div class="arithmatex">\[a &lt; b^2\]</div>')
    assert page.startswith("<math")
    assert "&#x0003C;" in page  # the sign, escaped once
    assert "arithmatex" not in page


def test_equation_with_an_unknown_command_is_refused() -> None:
    with pytest.raises(ValueError, match="write it otherwise"):
        site_pages.on_page_content(r'<span class="arithmatex">\(\argh x\)</span>')


def test_example_of_a_docstring_becomes_a_block_of_code() -> None:
    text = "Read.\n\n>>> one\n>>> two\n3\n\nArgs:"
    assert site_pages.EXAMPLE.sub("X", text) == "Read.\n\nX\n\nArgs:"
