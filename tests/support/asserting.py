"""Assertions that several tests make: input is refused in one line, a value exists, nothing is meshed."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

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


T = TypeVar("T")


def not_none(value: T | None) -> T:
    """The value, which is not missing."""
    assert value is not None
    return value


def forbid_meshing(monkeypatch: pytest.MonkeyPatch) -> None:
    """TetGen, a process of its own, cannot be started."""
    run = subprocess.run

    def other_commands(command: Any, *more: Any, **options: Any) -> Any:
        assert not any("tetgen" in str(word) for word in command), "it was meshed"
        return run(command, *more, **options)

    monkeypatch.setattr(subprocess, "run", other_commands)
