"""An exported problem is solved by CalculiX as it stands; both laws agree where strains are small."""

import shutil
import subprocess

import numpy as np
import pytest

from support.models import model_of, settle
from support.small_trunk import small_case
from warp_trunk.bone_motion.prescribed_motion import spline_path
from warp_trunk.engine.tissue import Tissue
from warp_trunk.io.volume_writer import write_volume

pytestmark = pytest.mark.slow

CCX = shutil.which("ccx")


def solved_by_calculix(folder, trunk, motion, tissue):
    write_volume(folder / "problem.inp", trunk, motion, tissue)
    assert CCX is not None
    subprocess.run([CCX, "problem"], cwd=folder, check=True, capture_output=True, timeout=120)
    displacement, on = {}, False
    for line in (folder / "problem.frd").read_text(encoding="utf-8").splitlines():
        if line.startswith(" -4  DISP"):
            on = True  # the last step written is the end
        elif line.startswith(" -3"):
            on = False
        elif on and line.startswith(" -1"):
            displacement[int(line[3:13]) - 1] = [float(line[13 + 12 * k : 25 + 12 * k]) for k in range(3)]
    return np.array([displacement[node] for node in range(len(trunk.nodes))])


@pytest.mark.skipif(CCX is None, reason="CalculiX (ccx) is not installed; Debian has it as calculix-ccx")
def test_the_two_laws_differ_by_the_square_of_the_motion(tmp_path):
    case, trunk = small_case()
    tissue = Tissue(poisson_ratio=0.4)
    whole = spline_path(trunk.nodes, case.landmarks_before, case.planned_landmarks).displacement
    apart = []
    for part in (0.1, 0.05):
        folder = tmp_path / str(part)
        folder.mkdir()
        calculix = solved_by_calculix(folder, trunk, part * whole, tissue)
        model = model_of(trunk, tissue, energy="neo-hookean")
        ours = settle(model, part * whole, 5, tolerance=1e-6).displacement
        apart.append(np.abs(calculix - ours).max() / np.abs(ours).max())
    assert apart[0] < 0.01
    assert apart[1] == pytest.approx(0.5 * apart[0], rel=0.1)  # of the motion, so the square in mm
