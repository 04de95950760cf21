"""A good case, made once and copied for each row of a table."""

import shutil
from pathlib import Path

import pytest

from support.small_case import small_case
from warp_trunk.case import write_case


@pytest.fixture(scope="session")
def good_case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case that passes every check; not to be changed."""
    folder = tmp_path_factory.mktemp("good") / "case"
    write_case(folder, small_case())
    return folder


@pytest.fixture
def case(good_case: Path, tmp_path: Path) -> Path:
    """A copy of it, to be broken."""
    return Path(shutil.copytree(good_case, tmp_path / "case"))
