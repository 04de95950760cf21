from pathlib import Path

import numpy as np
import pytest

from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.errors import InputError
from warp_trunk.measures.spine import spine_of
from warp_trunk.preparation.deformity import SpineCurve, correct, read_measured_spine
from warp_trunk.preparation.deformity.spine_curve import vertebra_poses
from warp_trunk.preparation.phantom import straight_trunk

STRAIGHT = straight_trunk()[2]
CURVE = SpineCurve(cobb=50.0)


def written(folder: Path, levels: tuple[str, ...] = VERTEBRAE, edit: str = "") -> Path:
    """Body centres and pedicles of a curved spine as a table."""
    spine = spine_of(correct(STRAIGHT, CURVE, 0.0))
    lines = ["name,x,y,z"]
    for level in levels:
        row = spine.levels.index(level)
        points = (spine.endplates[row].mean(axis=0), *spine.pedicles[row])
        for part, point in zip(("body", "left_pedicle", "right_pedicle"), points, strict=True):
            lines.append(f"{level}_{part}," + ",".join(f"{value:.3f}" for value in point))
    path = folder / "spine.csv"
    path.write_text("\n".join([*lines, edit] if edit else lines) + "\n")
    return path


def test_curve_is_found_again_in_its_points(tmp_path: Path) -> None:
    found = vertebra_poses(STRAIGHT, read_measured_spine(written(tmp_path)))
    true = vertebra_poses(STRAIGHT, CURVE)
    for level in VERTEBRAE[1:-1]:
        assert np.degrees(found[level].tilt - true[level].tilt) == pytest.approx(0.0, abs=3.0), level
        assert np.degrees(found[level].rotation - true[level].rotation) == pytest.approx(0.0, abs=3.0), level
    apart = [found[level].after - true[level].after for level in VERTEBRAE]
    assert np.linalg.norm(apart, axis=1).max() < 6.0


def test_levels_above_the_highest_fade_out(tmp_path: Path) -> None:
    spine = read_measured_spine(written(tmp_path, VERTEBRAE[4:]))
    assert spine.continued == ("T1", "T2", "T3", "T4")
    assert (np.diff(np.abs(spine.tilt[:5])) > 0.0).all()
    assert (np.diff(np.abs(spine.turn[:5])) > 0.0).all()


@pytest.mark.parametrize(
    ("levels", "edit", "rule"),
    [
        (VERTEBRAE[12:], "", "8 or more levels"),
        (VERTEBRAE[:12], "", "down to L5"),
        (VERTEBRAE[8:], "T8_body,0,0,9", "'T8_left_pedicle' is missing"),
        (VERTEBRAE[8:], "T8_body,0,0,0\nT8_left_pedicle,1,0,0\nT8_right_pedicle,0,0,0", "runs the other way"),
    ],
)
def test_bad_tables_are_refused(tmp_path: Path, levels: tuple[str, ...], edit: str, rule: str) -> None:
    with pytest.raises(InputError, match=rule):
        read_measured_spine(written(tmp_path, levels, edit))
