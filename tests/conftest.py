"""What tests share. This folder is on the import path, for the helpers beside this file."""

import pytest

from warp_trunk.parallel import Parallel


@pytest.fixture
def split_small_meshes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets also the smallest launch run in a range for each thread, so that tiny meshes test the threads."""
    monkeypatch.setattr(Parallel.record, "__defaults__", (1,))
