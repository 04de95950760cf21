"""Reference pages made from the program."""

from dataclasses import fields
from pathlib import Path

import reference_pages

import warp_trunk
from warp_trunk.case.rib_coupling import RANGES, RibCoupling
from warp_trunk.case.uncertainty import REFERENCES, Uncertainty
from warp_trunk.cli.commands import COMMANDS
from warp_trunk.measures.quantities import QUANTITIES

ROOT = Path(__file__).parents[2]


def test_every_command_and_every_public_name_has_a_part() -> None:
    commands, names = reference_pages.commands_page(), reference_pages.python_page()
    assert [name for name in COMMANDS if f"\nusage: warp-trunk {name} [" not in commands] == []
    assert [name for name in warp_trunk.__all__ if f"\n### {name}\n" not in names] == []


def rows(page: str) -> dict[str, list[str]]:
    """Cells of the rows of a page as the site shows it, by the name in backticks in their first cell."""
    lines = reference_pages.filled((ROOT / "docs" / page).read_text(encoding="utf-8")).splitlines()
    return {line.split("`")[1]: line.strip("| ").split(" | ") for line in lines if line.startswith("| `")}


def test_sources_of_error_have_their_default_and_its_origin() -> None:
    table = rows("how_sure.md")
    for name in (field.name for field in fields(Uncertainty)):
        assert float(table[name][2]) == getattr(Uncertainty(), name)
        assert any(name.startswith(key) and text == table[name][3] for key, text in REFERENCES.items())


def test_shares_of_ribs_have_their_default_and_their_range() -> None:
    table = rows("ribs.md")
    for field in fields(RibCoupling):
        least, most = RANGES[field.name]
        assert table[field.name][2:] == [f"{field.default:g}", f"{least:g} to {most:g}"]


def test_every_quantity_is_on_the_page_of_results() -> None:
    table = rows("result.md")
    assert {key: table[key][2] for key in QUANTITIES} == {key: q.unit for key, q in QUANTITIES.items()}
