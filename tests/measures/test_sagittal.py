"""Kyphosis and lordosis of spines whose angles are known."""

import numpy as np
import pytest

from support.known_spine import known_spine
from support.trunk_shapes import with_points
from warp_trunk.measures.cobb import kyphosis, lordosis
from warp_trunk.measures.spine import spine_of

ROUND = {"T1": -24.0, "T5": -18.0, "T12": 14.0, "L1": 15.0, "L5": -22.0}
"""Tilt backwards by level: forward at the top, back at the thoracolumbar junction, forward at the bottom."""


def angles(landmarks):
    spine = spine_of(landmarks)
    return {**kyphosis(spine), **lordosis(spine)}


def test_angles_are_those_between_the_axes_it_was_built_with():
    found = angles(known_spine(back=ROUND))
    assert found["T1-T12"] == pytest.approx(38.0, abs=1e-9)
    assert found["T5-T12"] == pytest.approx(32.0, abs=1e-9)
    assert found["L1-L5"] == pytest.approx(37.0, abs=1e-9)


def test_scoliosis_and_axial_rotation_change_nothing_seen_from_the_side():
    curved = known_spine(
        to_left={"T1": 10.0, "T5": 30.0, "T12": -30.0, "L5": 0.0}, back=ROUND, turned={"T8": 25.0, "L2": -10.0}
    )
    plain = angles(known_spine(back=ROUND))
    assert angles(curved) == pytest.approx({**plain, "L1-S1": None}, abs=1e-9)


@pytest.mark.parametrize("bone", ["S1", "sacrum"])
def test_lordosis_reaches_the_sacrum_where_it_has_landmarks(bone):
    """The axis of S1 leans forward by 40 degrees; that of L1 leans back by 15."""
    lean = np.radians(40.0)
    upper = np.array([0.0, 45.0, -60.0])
    lower = upper - 20.0 * np.array([0.0, -np.sin(lean), np.cos(lean)])
    points = {f"{bone}_superior_endplate": upper, f"{bone}_inferior_endplate": lower}
    found = angles(with_points(known_spine(back=ROUND), points))
    assert found["L1-S1"] == pytest.approx(55.0, abs=1e-9)
    assert found["L1-L5"] == pytest.approx(37.0, abs=1e-9)
