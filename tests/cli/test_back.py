"""The fusion that `fit-back` proposes."""

import pytest

from warp_trunk.cli.back import fused
from warp_trunk.measures import CobbAngle


@pytest.mark.parametrize(
    ("curve", "ends"),
    [
        (("T5", "T12", "T8"), ("T4", "L1")),
        (("T11", "L4", "L2"), ("T11", "L4")),
        (("T12", "L4", "L1"), ("T12", "L4")),
    ],
)
def test_a_fusion_holds_the_apex_of_the_curve_that_it_corrects(
    curve: tuple[str, str, str], ends: tuple[str, str]
) -> None:
    assert fused(CobbAngle(30.0, *curve, "left")) == ends
