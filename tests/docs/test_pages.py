"""Pages agree with the program: links, commands, and tables of constants."""

import re
import tomllib
from pathlib import Path

import pytest

from warp_trunk.case import landmarks
from warp_trunk.case.layers import CONSTANTS, Layers
from warp_trunk.case.rib_coupling import RibCoupling
from warp_trunk.case.uncertainty import Uncertainty
from warp_trunk.cli.commands import COMMANDS
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.tissue import Tissue
from warp_trunk.io import surface_files, volume_files, volume_writer

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").glob("*.md"))
OUTSIDE = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]


def rows(page: str) -> dict[str, list[str]]:
    """Rows of the tables of a page, cells without Markdown, by each name in backticks in their first cell."""
    rows_of = {}
    for line in (ROOT / "docs" / page).read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        for name in re.findall(r"`(\w+)`", cells[0]) if line.startswith("|") else []:
            rows_of[name] = cells
    return rows_of


def anchors(page: Path) -> set[str]:
    """Anchors of the headings of a page, as GitHub and MkDocs name them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", OUTSIDE, ids=lambda page: page.name)
def test_links_beside_the_site_lead_to_a_file_and_a_heading(page: Path) -> None:
    links = re.findall(r"\]\((?!https?:)([^)#]*)#?([^)]*)\)", page.read_text(encoding="utf-8"))
    assert links
    for file, anchor in links:
        assert (ROOT / file).is_file(), file
        assert not anchor or anchor in anchors(ROOT / file), f"{file}#{anchor}"


@pytest.mark.parametrize("page", [*PAGES, *OUTSIDE], ids=lambda page: page.name)
def test_no_page_names_a_folder_of_a_machine(page: Path) -> None:
    assert not re.search(r"(?<![\w.])/(work|tmp|home|root|Users)/", page.read_text(encoding="utf-8"))


def test_readme_names_every_command() -> None:
    table = (ROOT / "README.md").read_text(encoding="utf-8").split("| command |")[1]
    assert [name for name in COMMANDS if f"`{name}`" not in table] == []


def test_every_status_has_advice() -> None:
    assert {status.name for status in RelaxStatus} <= {
        line.split("|")[1].strip()
        for line in (ROOT / "docs/troubleshooting.md").read_text(encoding="utf-8").splitlines()
        if "|" in line
    }


def test_formats_of_the_page_are_those_that_are_read_and_written() -> None:
    lines = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8").splitlines()
    table = {cells[1].strip(): cells[2:4] for line in lines if len(cells := line.split("|")) == 5}
    endings = {"Gmsh": ".msh", "Abaqus INP": ".inp", "FEBio": ".feb"}

    def stated(text: str) -> set[str]:
        """Endings of the formats of a cell, up to where another command begins."""
        names = re.split(r", | and ", re.sub(r"^`[^`]+`: |, by .*|;.*", "", text.strip()))
        return {endings.get(name, f".{name.lower()}") for name in names}

    assert stated(table["surfaces"][0]) == surface_files.ENDINGS
    assert stated(table["surfaces"][1]) == set(surface_files.WRITTEN)
    assert [stated(cell) for cell in table["meshes"]] == [set(volume_files.ENDINGS), set(volume_writer.ENDINGS)]
    assert all(ending in table["landmarks"][0] for ending in landmarks.ENDINGS if ending != ".csv")


def test_values_of_the_example_of_a_case_are_the_defaults() -> None:
    """The header of docs/case.md, as Python reads it, gives the constants of the program."""
    text = (ROOT / "docs" / "case.md").read_text(encoding="utf-8")
    (example,) = [block for block in re.findall(r"```toml\n(.*?)```", text, re.DOTALL) if "[uncertainty]" in block]
    tables = tomllib.loads(example)
    layers = tables["layers"]
    assert {name: layers.pop(name)["youngs_modulus"] for name in ("fat",)} == {
        "fat": CONSTANTS["fat"]["youngs_modulus"]
    }
    for name, record in (
        ("tissue", Tissue()),
        ("layers", Layers()),
        ("ribs", RibCoupling()),
        ("uncertainty", Uncertainty()),
    ):
        assert {key: getattr(record, key) for key in tables[name]} == tables[name]
