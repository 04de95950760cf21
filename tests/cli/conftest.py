"""Commands that are run in an empty folder."""

from pathlib import Path

import pytest

from support.console import Console


@pytest.fixture
def console(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Console:
    """The commands of a test, and all that they print."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("UV_RUN_RECURSION_DEPTH", raising=False)
    return Console(tmp_path, capsys)
