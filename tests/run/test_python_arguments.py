"""Wrong arguments of a script are refused in one sentence, as on the command line."""

# The wrong types are what is tested:
# pyright: reportArgumentType=false

import pytest

from support.small_case import small_case
from warp_trunk import InputError, measure
from warp_trunk.case.landmarks import Landmarks
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.meshing import make_trunk


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: SimulationOptions(increments=2.5), "increments: 2.5 must be of type int, not float; give"),
        (lambda: Landmarks(("a", "b"), [[0.0, 0, 0], [1.0, 0, 0]]), r"landmarks: points .*ndarray, not list"),
        (lambda: make_trunk("path", {}), "make_trunk: 'skin' must be of type Surface, not str; read it with"),
        (lambda: make_trunk(small_case().skin, {}), "make_trunk: 'bones' is empty; give the surface of each"),
        (lambda: make_trunk(small_case().skin, {"T7": "T7.ply"}), "make_trunk: bone 'T7' must be of type"),
        (lambda: measure(small_case().skin, small_case().skin), "measure: 'landmarks' must be of type Landmarks"),
    ],
)
def test_another_type_is_told_in_one_sentence(wrong, said):
    with pytest.raises(InputError, match=said) as error:
        wrong()
    assert "\n" not in str(error.value)
