"""No number is given of skin that was not measured."""

import numpy as np

from support.asserting import not_none
from support.phantoms import coarse_phantom
from warp_trunk.measures import measure
from warp_trunk.measures.back_rotation import FLANK, is_hump_determined
from warp_trunk.measures.measures import INVENTED
from warp_trunk.measures.quantities import measured

CASE = coarse_phantom()
WHOLE = measure(CASE.skin, CASE.landmarks_before)


def known_levels(unseen: np.ndarray) -> dict[str, set[str]]:
    """The levels at which each quantity is known where some of the skin was not measured."""
    levels: dict[str, set[str]] = {}
    for row in measured("before", measure(CASE.skin, CASE.landmarks_before, unseen=unseen), WHOLE):
        if row.value is not None:
            levels.setdefault(row.quantity, set()).add(row.level)
    return levels


def test_an_invented_front_takes_shoulders_and_flanks_and_leaves_the_back() -> None:
    depth = CASE.skin.vertices[:, 1]
    back = np.quantile(depth, 0.7)
    seen, every = known_levels(depth < back), known_levels(np.zeros(len(depth)))
    assert "shoulder_difference_mm" in every
    for quantity in ("shoulder_difference_mm", "waist_height_mm", "waist_depth_mm"):
        assert quantity not in seen, quantity
    assert not seen.get("flank_asymmetry_percent")
    marks = measure(CASE.skin, CASE.landmarks_before, unseen=depth < back)
    assert marks.missing["shoulders"] == marks.missing["waist"] == INVENTED
    assert {"T6", "T8", "T10", "T12"} <= seen["bsr_deg"]
    assert seen["cobb_deg"] == every["cobb_deg"]  # of the bones, not of the skin


def test_a_hump_that_depends_on_the_place_of_the_spine_is_missing_with_its_reason() -> None:
    """Of a fitted case; where the spine is known, it is shown."""
    measures = measure(CASE.skin, CASE.landmarks_before, unseen=np.zeros(len(CASE.skin.vertices)))
    for level, tangent in WHOLE.tangents.items():
        shown = measures.hump_height[level] is not None
        if tangent is not None and measures.bsr[level] is not None:
            assert shown == is_hump_determined(tangent), level
            assert shown == (f"hump {level}" not in measures.missing), level
    assert {FLANK} == {why for what, why in measures.missing.items() if what.startswith("hump")}
    assert any(measures.hump_height.values())


def test_one_invented_level_is_missing_with_its_reason() -> None:
    section = not_none(WHOLE.tangents["T8"])
    unseen = np.abs(CASE.skin.vertices[:, 2] - section.height) < 12.0
    measures = measure(CASE.skin, CASE.landmarks_before, unseen=unseen)
    assert measures.bsr["T8"] is None
    assert measures.hump_height["T8"] is None
    assert measures.slopes["T8"] is None
    assert measures.slopes["T12"] == WHOLE.slopes["T12"]
    assert "the scan shows no back" in measures.missing["T8"]
    assert measures.bsr["T12"] == WHOLE.bsr["T12"]
    moved = CASE.skin.moved(CASE.skin.vertices + np.where(unseen, 9.0, 1.0)[:, None])
    change = measure(moved, CASE.landmarks_before, CASE.skin, unseen=unseen)
    assert not_none(change.skin_change_max) < 2.0  # what is invented moves by 16 mm
