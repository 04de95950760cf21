"""Real anatomy, read once by the tests of a process; without it they are skipped."""

import os
from functools import cache
from pathlib import Path

import pytest
from trunks import read_trunk

from warp_trunk.case.landmarks import Landmarks
from warp_trunk.geometry.surface import Surface
from warp_trunk.preparation.landmark_finder import find_landmarks


@cache
def anatomy() -> tuple[Surface, dict[str, Surface]]:
    """Skin and bones of the folder that WARP_TRUNK_ANATOMY names."""
    folder = os.environ.get("WARP_TRUNK_ANATOMY")
    if not folder or not Path(folder).is_dir():
        pytest.skip("WARP_TRUNK_ANATOMY names no folder with skin.ply and bones/")
    return read_trunk(Path(folder))


@cache
def anatomy_landmarks() -> Landmarks:
    """Its landmarks, found on its bones."""
    return find_landmarks(anatomy()[1]).complete()
