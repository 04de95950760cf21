"""A label map of 512 x 512 x 900 voxels fits into memory, read in a process of its own."""

import subprocess
import sys

import numpy as np
import pytest
from voxelise_case import write_labels

from support.label_maps import NAMES, NUMBERS

pytestmark = pytest.mark.slow

SHAPE = (512, 512, 900)
MOST = 2e9
"""Bytes."""
# Not ru_maxrss: a process inherits that of the one that began it.
READ = """
import sys
from pathlib import Path
from warp_trunk.preparation.label_maps import read_source
from warp_trunk.preparation.label_maps.sources import read_body
found = read_source(Path(sys.argv[1]))
body = read_body(Path(sys.argv[1]))
most = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
print(len(found.masks), body.inside.shape, 1024 * int(most.split()[1]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_large_map_is_read_within_two_gigabytes(tmp_path):
    values = np.zeros(SHAPE, dtype=np.uint8, order="F")
    for place, name in enumerate(("vertebrae_T5", "vertebrae_T6", "sternum", "hip_left", "hip_right")):
        low = 40 + 90 * place
        values[low : low + 60, 100:400, low : low + 300] = NUMBERS[name]
    values[0, 0, 0] = values[-1, -1, -1] = NUMBERS["sacrum"]  # as large as a box can be
    write_labels(tmp_path / "a.nii", values, np.diag([0.8, 0.8, 0.75, 1.0]), NAMES)
    del values
    run = subprocess.run([sys.executable, "-c", READ, str(tmp_path / "a.nii")], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr[-500:]
    masks, *shape, memory = run.stdout.replace("(", "").replace(")", "").replace(",", "").split()
    assert (int(masks), tuple(map(int, shape))) == (6, SHAPE)
    assert float(memory) < MOST
