"""The lines in which input is refused, as rows of an accepted text."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from warp_trunk.errors import InputError

_OF_A_LIBRARY = re.compile(r"(cannot be read as (?:TOML|markups)|another version of the program) \(.*\)")


def plain_line(line: str, folder: Path) -> str:
    """A line without the places of this computer, and without what a library says in brackets."""
    for place in (folder.resolve(), folder):
        line = line.replace(str(place), "FOLDER")
    return _OF_A_LIBRARY.sub(r"\1 (...)", line.removeprefix("warp-trunk: ").replace("\\", "/"))


@contextmanager
def row(name: str) -> Iterator[None]:
    """A row of a table; its name is noted at an error."""
    try:
        yield
    except BaseException as error:
        error.add_note(f"row: {name}")
        raise


def refusal(name: str, folder: Path, call: Callable[[], object]) -> str:
    """The row of an input that a call must refuse in one line."""
    with row(name):
        with pytest.raises(InputError) as error:
            call()
        assert "\n" not in str(error.value)
    return f"{name}: {plain_line(str(error.value), folder)}"
