"""Curve types by Lenke of spines whose tilts are given."""

from dataclasses import replace

import numpy as np
import pytest

from support.known_spine import known_spine
from support.phantoms import whole_phantom
from warp_trunk.bone_motion.plan import lenke_of
from warp_trunk.case.landmarks import NO_LANDMARKS
from warp_trunk.spine.cobb import cobb_angles
from warp_trunk.spine.lenke import lenke_type
from warp_trunk.spine.spine import SacralLine, sacral_line, spine_of


def type_of(
    tilts: dict[str, float], flexibility: dict[str, float] | None = None, back: dict[str, float] | None = None
) -> str:
    marks = known_spine(to_left=tilts, back=back)
    return lenke_type(spine_of(marks), cobb_angles(marks), sacral_line(marks), flexibility)[:1]


@pytest.mark.parametrize(
    ("tilts", "kind"),
    [
        ({"T1": 0.0, "T5": 25.0, "T11": -25.0, "L5": 0.0}, "1"),
        ({"T1": -25.0, "T5": 25.0, "T11": -30.0, "L5": -10.0}, "2"),
        ({"T1": 5.0, "T5": 25.0, "T11": -30.0, "L4": 20.0, "L5": 15.0}, "3"),
        ({"T1": -25.0, "T5": 25.0, "T11": -30.0, "L4": 20.0, "L5": 15.0}, "4"),
        ({"T1": 0.0, "T5": 4.0, "T10": -24.0, "L4": 24.0, "L5": 20.0}, "5"),
        ({"T1": 15.0, "T5": 24.0, "T10": -24.0, "L4": 28.0, "L5": 20.0}, "6"),
        ({"T1": 0.0, "L5": 0.0}, ""),
    ],
)
def test_the_type_follows_the_sizes_of_the_curves(tilts: dict[str, float], kind: str) -> None:
    assert type_of(tilts) == kind


def test_films_decide_where_they_are() -> None:
    """A lumbar curve of 50 beside a thoracic one of 55 that bends out to 20 is not structural, one to 30 is."""
    tilts = {"T1": 5.0, "T5": 25.0, "T11": -30.0, "L4": 20.0, "L5": 15.0}
    lumbar = next(curve for curve in cobb_angles(known_spine(to_left=tilts)) if curve.apex[0] == "L")
    assert type_of(tilts, {lumbar.apex: 0.6}) == "1"
    assert type_of(tilts, {lumbar.apex: 0.4}) == "3"


def test_a_round_junction_is_structural() -> None:
    straight = {"T1": 0.0, "T5": 25.0, "T11": -25.0, "L4": 0.0, "L5": 0.0}
    assert type_of(straight) == "1"
    assert type_of(straight, back={"T10": 0.0, "L2": 25.0}) == "3"


def test_the_modifier_says_where_the_sacral_line_passes_the_apex() -> None:
    """Pedicles are 24 mm apart: the line passes between them within 12 mm, and the body within 22.8 mm."""
    marks = known_spine(to_left={"T1": 0.0, "T5": 25.0, "T11": -25.0, "L3": 5.0, "L5": 0.0})
    spine, curves = spine_of(marks), cobb_angles(marks)
    lumbar = next(curve for curve in curves if curve.apex[0] == "L" or curve.apex == "T12")
    apex = spine.endplates[spine.levels.index(lumbar.apex)].mean(axis=0)[:2]
    for aside, modifier in ((11.0, "A"), (-13.0, "B"), (22.0, "B"), (24.0, "C")):
        line = SacralLine(apex + np.array([aside, 0.0]), np.array([1.0, 0.0]), "L5")
        assert lenke_type(spine, curves, line)[1:] == modifier


def test_a_case_has_the_type_of_its_spine_and_none_without() -> None:
    case = whole_phantom()
    marks = case.landmarks_before
    assert lenke_of(case) == lenke_type(spine_of(marks), cobb_angles(marks), sacral_line(marks))
    assert lenke_of(case)
    assert lenke_of(replace(case, landmarks_before=NO_LANDMARKS, landmarks_after=None)) == ""
