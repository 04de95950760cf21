"""Input that is refused in one line."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from warp_trunk.errors import InputError


@contextmanager
def refuses(*parts: str, begins: Path | str = "") -> Iterator[None]:
    """The block must raise an InputError whose one line begins so and holds all the parts."""
    with pytest.raises(InputError) as error:
        yield
    line = str(error.value)
    assert line.startswith(str(begins)), line
    assert [part for part in parts if part not in line] == [], line
    assert "\n" not in line
