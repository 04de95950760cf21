"""A compiled kernel that is cut off is compiled again, and others stay."""

import struct

import pytest
from warp_trunk.kernels.starting import drop_damaged_kernels


@pytest.mark.parametrize("keep", [0, 10, 64, 500, 1000])
def test_compiled_modules_that_are_cut_off_are_removed(keep, tmp_path):
    head = bytearray(64)
    head[:4] = b"\x7fELF"
    struct.pack_into("<Q", head, 40, 1000 - 2 * 64)  # where the table of sections stands
    struct.pack_into("<HH", head, 58, 64, 2)
    (tmp_path / "wp_warp_trunk.kernels.a_1").mkdir()
    (tmp_path / "other").mkdir()
    for place in ("wp_warp_trunk.kernels.a_1/a.o", "other/a.o"):
        (tmp_path / place).write_bytes(bytes(head).ljust(1000, b"\0")[:keep])
    drop_damaged_kernels(tmp_path)
    assert (tmp_path / "wp_warp_trunk.kernels.a_1" / "a.o").exists() == (keep == 1000)
    assert (tmp_path / "other" / "a.o").exists()
