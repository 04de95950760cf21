"""A part of the body without a spine: a ball of tissue with a fixed bone, and one in front that moves."""

from warp_trunk.case import Case
from warp_trunk.case.landmarks import NO_LANDMARKS
from warp_trunk.case.motions import Motion

from .synthetic import sphere


def part_case(**motions: Motion) -> Case:
    """`core` in the middle, `front` before it and a small `left` and `right`, 5 mm or more apart."""
    return Case(
        name="part",
        skin=sphere(80.0, (0.0, 0.0, 100.0)),
        bones={
            "core": sphere(25.0, (0.0, 20.0, 100.0)),
            "front": sphere(18.0, (0.0, -45.0, 100.0)),
            "left": sphere(12.0, (45.0, 0.0, 100.0)),
            "right": sphere(12.0, (-45.0, 0.0, 100.0)),
        },
        landmarks_before=NO_LANDMARKS,
        motions=motions,
    )
