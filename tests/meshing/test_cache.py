from dataclasses import fields, replace

import numpy as np
import pytest

from support.asserting import there
from support.synthetic import shell_trunk, sphere
from warp_trunk.geometry.surface import Surface
from warp_trunk.meshing.cache import cache_key, load_cached, store_cached

KEY = "0" * 64


@pytest.fixture(scope="module")
def trunk():
    return shell_trunk()


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("WARP_TRUNK_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


def test_a_mesh_comes_back(trunk, folder):
    assert load_cached(KEY) is None
    store_cached(KEY, trunk)
    back = there(load_cached(KEY))
    for field in fields(trunk):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(trunk, field.name))
    assert [path.name for path in folder.iterdir()] == [f"mesh-{KEY}.npz"]


def test_folder_that_cannot_be_written_only_warns(trunk, folder):
    folder.write_text("a file where the folder should be")
    with pytest.warns(UserWarning, match="could not be kept"):
        store_cached(KEY, trunk)


def test_key_depends_on_every_part():
    skin, bone = sphere(10.0), sphere(2.0)
    moved = Surface(skin.vertices + np.array([0.0, 0.0, 1e-12]), skin.faces)
    turned = Surface(skin.vertices, np.roll(skin.faces, 1, axis=0))
    keys = [cache_key(one, {"a": bone}, "o") for one in (skin, moved, turned)]
    keys += [
        cache_key(skin, bones, "o") for bones in ({"b": bone}, {"a": bone, "b": bone}, {"b": bone, "a": bone})
    ]
    assert len({*keys, cache_key(skin, {"a": bone}, "p")}) == 7
    assert cache_key(skin, {"a": bone}, "o") == keys[0]


@pytest.mark.parametrize(
    "spoil",
    [lambda b: b[:1000], lambda b: b[: len(b) // 2] + bytes([b[len(b) // 2] ^ 0xFF]) + b[len(b) // 2 + 1 :]],
    ids=["cut", "a byte changed"],
)
def test_a_damaged_file_is_made_again(trunk, folder, spoil):
    store_cached(KEY, trunk)
    for path in folder.iterdir():
        path.write_bytes(spoil(path.read_bytes()))
    assert load_cached(KEY) is None


def test_a_mesh_of_another_key_or_whose_parts_do_not_fit_is_not_used(trunk, folder):
    store_cached(KEY, trunk)
    (folder / f"mesh-{KEY}.npz").rename(folder / f"mesh-{'1' * 64}.npz")
    assert load_cached("1" * 64) is None
    store_cached(KEY, replace(trunk, tets=trunk.tets[:, [0, 2, 1, 3]]))
    assert load_cached(KEY) is None
