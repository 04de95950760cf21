from dataclasses import fields, replace

import numpy as np
import pytest

from support.synthetic import shell_trunk, sphere
from warp_trunk.geometry.surface import Surface
from warp_trunk.meshing.cache import cache_folder, cache_key, load_cached, store_cached

KEY = "0" * 64


@pytest.fixture(scope="module")
def trunk():
    return shell_trunk()


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("WARP_TRUNK_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


def test_mesh_comes_back_atomic_write(trunk, folder):
    assert load_cached(KEY) is None
    store_cached(KEY, trunk)
    back = load_cached(KEY)
    assert back is not None
    for field in fields(trunk):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(trunk, field.name))
    assert [path.name for path in folder.iterdir()] == [f"mesh-{KEY}.npz"]


@pytest.mark.parametrize("where", [0.1, 0.5, 0.9])
def test_changed_byte_is_noticed(trunk, folder, where):
    store_cached(KEY, trunk)
    (path,) = folder.iterdir()
    content = bytearray(path.read_bytes())
    content[int(where * len(content))] ^= 0xFF
    path.write_bytes(content)
    assert load_cached(KEY) is None


def test_cut_file_and_file_of_another_key_are_not_used(trunk, folder):
    store_cached(KEY, trunk)
    path = folder / f"mesh-{KEY}.npz"
    path.rename(folder / f"mesh-{'1' * 64}.npz")
    assert load_cached("1" * 64) is None
    store_cached(KEY, trunk)
    path.write_bytes(path.read_bytes()[:1000])
    assert load_cached(KEY) is None


def test_mesh_that_does_not_fit_together_is_not_used(trunk):
    store_cached(KEY, replace(trunk, tets=trunk.tets[:, [0, 2, 1, 3]]))
    assert load_cached(KEY) is None


def test_folder_that_cannot_be_written_only_warns(trunk, folder):
    folder.write_text("a file where the folder should be")
    with pytest.warns(UserWarning, match="could not be kept"):
        store_cached(KEY, trunk)


def test_key_depends_on_every_part():
    skin, bone = sphere(10.0), sphere(2.0)
    moved = Surface(skin.vertices + np.array([0.0, 0.0, 1e-12]), skin.faces)
    turned = Surface(skin.vertices, np.roll(skin.faces, 1, axis=0))
    keys = [
        cache_key(skin, {"a": bone}, "o"),
        cache_key(moved, {"a": bone}, "o"),
        cache_key(turned, {"a": bone}, "o"),
        cache_key(skin, {"b": bone}, "o"),
        cache_key(skin, {"a": bone, "b": bone}, "o"),
        cache_key(skin, {"b": bone, "a": bone}, "o"),
        cache_key(skin, {"a": bone}, "p"),
    ]
    assert len(set(keys)) == 6 + 1 - (keys[4] == keys[5])
    assert keys[4] != keys[5]
    assert cache_key(skin, {"a": bone}, "o") == keys[0]


def test_folder_is_the_systems_place_without_the_variable(monkeypatch, tmp_path):
    monkeypatch.delenv("WARP_TRUNK_CACHE")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "warp-trunk"
