import dataclasses
from pathlib import Path

import numpy as np
import pytest

from support.meshes import block_with_bone
from warp_trunk.meshing.cache import SetUpCache

TRUNK = block_with_bone((3, 3, 3), holes=((1, 1, 1),))
VALUES = np.arange(5000)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("WARP_TRUNK_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


def found(cache: SetUpCache) -> bool:
    """Whether the values have to be found, and are not in the file."""
    np.testing.assert_array_equal(
        cache.memo.arrays("part", lambda: {"values": VALUES}, lambda _: True)["values"], VALUES
    )
    return cache.memo.is_new


def keep(settings: str) -> Path:
    cache = SetUpCache(TRUNK, settings)
    assert found(cache)
    cache.store()
    return cache.path


def test_what_was_found_is_read_the_next_time() -> None:
    keep("a")
    again = SetUpCache(TRUNK, "a")
    assert not found(again)
    again.path.unlink()
    again.store()  # nothing was found that the file had not
    assert not again.path.exists()


def test_each_mesh_has_one_file_with_the_settings_used_last(folder: Path) -> None:
    keep("a")
    keep("b")
    assert len(list(folder.iterdir())) == 1
    assert found(SetUpCache(TRUNK, "a"))
    assert not found(SetUpCache(TRUNK, "b"))


def test_another_mesh_is_another_file() -> None:
    path = keep("a")
    moved = TRUNK.nodes.copy()
    moved[0, 0] += 1e-12
    freed = TRUNK.bone.copy()
    freed[np.argmax(freed)] = -1
    others = (
        {"nodes": moved},
        {"tets": TRUNK.tets[::-1]},
        {"bone": freed},
        {"tissue": np.zeros(len(TRUNK.tets), dtype=np.int8)},
    )
    for other in others:
        cache = SetUpCache(dataclasses.replace(TRUNK, **other), "a")
        assert cache.path != path
        assert found(cache)


@pytest.mark.parametrize(
    "spoil", [lambda b: b[:100], lambda b: b[:3000] + bytes([b[3000] ^ 1]) + b[3001:], lambda _: b""]
)
def test_a_damaged_file_is_made_again(spoil) -> None:
    path = keep("a")
    path.write_bytes(spoil(path.read_bytes()))
    cache = SetUpCache(TRUNK, "a")
    assert found(cache)
    cache.store()
    assert not found(SetUpCache(TRUNK, "a"))


def test_a_folder_that_cannot_be_written_only_warns(folder: Path) -> None:
    folder.write_text("a file where the folder should be")
    cache = SetUpCache(TRUNK, "a")
    assert found(cache)
    with pytest.warns(UserWarning, match="could not be kept"):
        cache.store()
