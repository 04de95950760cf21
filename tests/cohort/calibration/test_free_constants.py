"""Constants that can be calibrated, and their scale."""

from typing import Any

import numpy as np
import pytest

from support.asserting import refuses
from support.small_case import small_case
from warp_trunk.case.tissue_file import constant_of
from warp_trunk.cohort.calibration.free_constants import FreeConstant, check_free, values_of
from warp_trunk.run.options import RunOptions

PAPERS: dict[str, Any] = {"bones": "spline"}
CONTINUUM: dict[str, Any] = {"bones": "spline", "energy": "neo-hookean"}


@pytest.mark.parametrize(
    ("names", "options", "why"),
    [
        (("poison_ratio",), {}, "did you mean 'poisson_ratio'?"),
        (("youngs_modulus",), PAPERS, "all forces grow with it alike"),
        (("youngs_modulus",), CONTINUUM, "give --gravity 9.81, or free the ratio of layers"),
        (("epsilon",), {}, "simulated with neo-hookean; give --energy itmsm"),
        (("poisson_ratio",), PAPERS, "give --energy neo-hookean"),
        (("ribs.reversible_part",), PAPERS, "give --bones follow"),
        (("fat.youngs_modulus",), {}, "give --layers depth"),
        (
            ("skin.youngs_modulus", "fat.youngs_modulus", "muscle.youngs_modulus"),
            {"layers": "depth"},
            "only ratios of the layers' Young's moduli act; leave one out",
        ),
    ],
)
def test_what_no_skin_tells_is_refused(names: tuple[str, ...], options: dict[str, Any], why: str) -> None:
    with refuses(why):
        check_free(names, small_case(), RunOptions(**options))


def test_constants_that_move_the_skin_are_accepted() -> None:
    check_free(("epsilon", "theta"), small_case(), RunOptions(**PAPERS))
    check_free(("youngs_modulus", "density"), small_case(), RunOptions(gravity=9.81))
    check_free(
        ("ribs.axial_rotation", "poisson_ratio", "fat.youngs_modulus"), small_case(), RunOptions(layers="depth")
    )


@pytest.mark.parametrize("name", ["poisson_ratio", "fat.youngs_modulus", "theta", "density", "ribs.scapula"])
def test_counting_goes_there_and_back(name: str) -> None:
    start = constant_of(small_case(), name)
    free = FreeConstant(name=name, start=start)
    counted = free.counted(start)
    assert values_of([free], np.array([counted]))[name] == pytest.approx(start)
    low, high = free.limits
    assert low <= counted <= high
    step = 1e-6
    change = (free.value(counted + step) - free.value(counted - step)) / (2.0 * step)
    assert free.slope(start) == pytest.approx(change, rel=1e-6)
    assert free.believed > 0.0
