"""A compiled kernel that is cut off is compiled again, and others stay."""

import os
import struct
import subprocess
import sys

import pytest
from warp_trunk.kernels.starting import drop_damaged_kernels


@pytest.mark.parametrize("keep", [0, 10, 64, 500, 1000])
def test_compiled_modules_that_are_cut_off_are_removed(keep, tmp_path):
    head = bytearray(64)
    head[:4] = b"\x7fELF"
    struct.pack_into("<Q", head, 40, 1000 - 2 * 64)  # where the table of sections stands
    struct.pack_into("<HH", head, 58, 64, 2)
    compiling = "wp_neo_hookean_float32_2_p123_t456"  # by another process
    for place in ("wp_neo_hookean_float32_1/a.o", f"{compiling}/a.o", "other/a.o"):
        (tmp_path / place).parent.mkdir()
        (tmp_path / place).write_bytes(bytes(head).ljust(1000, b"\0")[:keep])
    drop_damaged_kernels(tmp_path)
    assert (tmp_path / "wp_neo_hookean_float32_1" / "a.o").exists() == (keep == 1000)
    assert (tmp_path / compiling / "a.o").exists()
    assert (tmp_path / "other" / "a.o").exists()


@pytest.mark.slow
def test_doctor_runs_a_kernel_that_was_cut_off(tmp_path):
    command = [sys.executable, "-c", "from warp_trunk.cli import main; main(['doctor'])"]
    environment = {**os.environ, "WARP_CACHE_PATH": str(tmp_path)}
    for _ in range(2):
        done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=tmp_path)
        assert "ok      kernels " in done.stdout, done.stderr
        (compiled,) = tmp_path.rglob("wp_*/*.o")
        os.truncate(compiled, 100)
