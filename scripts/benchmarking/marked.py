"""Tables that scripts write into pages, each between two marks of its name."""

from __future__ import annotations

from pathlib import Path


def begin(name: str) -> str:
    """The line before a table."""
    return f"<!-- begin {name}: written by a script -->"


def end(name: str) -> str:
    """The line after it."""
    return f"<!-- end {name} -->"


def replaced(page: str, name: str, table: str) -> str:
    """The page with the table between its marks.

    Raises:
        ValueError: the marks are not there, once each and in their order.
    """
    first, last = begin(name), end(name)
    if page.count(first) != 1 or page.count(last) != 1 or page.index(first) > page.index(last):
        raise ValueError(f"the page needs the lines '{first}' and '{last}', once each and in this order")
    before, rest = page.split(first)
    return f"{before}{first}\n\n{table.strip()}\n\n{last}{rest.split(last)[1]}"


def write_into(path: Path, name: str, table: str) -> None:
    """The same in a file."""
    path.write_text(replaced(path.read_text(), name, table))
