"""Runs that must not come to the mesher."""

import subprocess
from typing import Any

import pytest


def forbid_meshing(monkeypatch: pytest.MonkeyPatch) -> None:
    """TetGen, a process of its own, cannot be started."""
    run = subprocess.run

    def others(command: Any, *more: Any, **options: Any) -> Any:
        assert not any("tetgen" in str(word) for word in command), "it was meshed"
        return run(command, *more, **options)

    monkeypatch.setattr(subprocess, "run", others)
