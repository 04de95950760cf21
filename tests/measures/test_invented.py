"""No number is given of skin that was not measured."""

import numpy as np

from support.asserting import there
from support.phantoms import coarse_phantom
from warp_trunk.measures import measure
from warp_trunk.measures.measures import INVENTED
from warp_trunk.measures.quantities import measured

CASE = coarse_phantom()
WHOLE = measure(CASE.skin, CASE.landmarks_before)


def known(unseen: np.ndarray) -> dict[str, set[str]]:
    """The levels at which each quantity is known where some of the skin was not measured."""
    found: dict[str, set[str]] = {}
    for row in measured("before", measure(CASE.skin, CASE.landmarks_before, unseen=unseen), WHOLE):
        if row.value is not None:
            found.setdefault(row.quantity, set()).add(row.level)
    return found


def test_an_invented_front_takes_shoulders_and_flanks_and_leaves_the_back() -> None:
    depth = CASE.skin.vertices[:, 1]
    back = np.quantile(depth, 0.7)
    found, every = known(depth < back), known(np.zeros(len(depth)))
    assert "shoulder_difference_mm" in every
    for quantity in ("shoulder_difference_mm", "waist_height_mm", "waist_depth_mm"):
        assert quantity not in found, quantity
    assert not found.get("flank_asymmetry_percent")
    marks = measure(CASE.skin, CASE.landmarks_before, unseen=depth < back)
    assert marks.missing["shoulders"] == marks.missing["waist"] == INVENTED
    assert {"T6", "T8", "T10", "T12"} <= found["bsr_deg"]
    assert found["cobb_deg"] == every["cobb_deg"]  # of the bones, not of the skin


def test_one_invented_level_is_missing_with_its_reason() -> None:
    section = there(WHOLE.tangents["T8"])
    unseen = np.abs(CASE.skin.vertices[:, 2] - section.height) < 12.0
    found = measure(CASE.skin, CASE.landmarks_before, unseen=unseen)
    assert found.bsr["T8"] is None
    assert found.hump_height["T8"] is None
    assert "the scan shows no back" in found.missing["T8"]
    assert found.bsr["T12"] == WHOLE.bsr["T12"]
    moved = CASE.skin.moved(CASE.skin.vertices + np.where(unseen, 9.0, 1.0)[:, None])
    change = measure(moved, CASE.landmarks_before, CASE.skin, unseen=unseen)
    assert there(change.skin_change_max) < 2.0  # what is invented moves by 16 mm
