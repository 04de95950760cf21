"""How ribs follow their vertebrae: the shares of a vertebra's motion, with the studies behind each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from warp_trunk.checking import bounds_of, check_fields


@dataclass(frozen=True, kw_only=True)
class RibCoupling:
    """The parts of a vertebra's motion against the pelvis that reach its ribs.

    A rib is pinned to its vertebra at its head, so it always takes the whole motion of that point, and it takes
    all of flexion and extension. The shares say what it takes of the rest.

    >>> dataclasses.replace(case, rib_coupling=wt.RibCoupling(reversible_part=0.5)).rib_coupling.upper
    -1.0
    """

    axial_rotation: Annotated[float, Meta(ge=0.0, le=1.5)] = 0.65
    """Of the turn about the vertebra's own axis, as a curve grows: with it, a curve imposed on straight anatomy
    gets the rib hump that patients have (Mattila et al. 2013, 12.3 ± 3.6 degrees at 56 degrees Cobb)."""
    lateral_bending: Annotated[float, Meta(ge=-0.5, le=1.5)] = 0.0
    """Of the tilt in the coronal plane. Ribs tie both sides of the cage to one sternum, which leans less than the
    vertebrae do; cage rotation follows axial rotation, not Cobb (Closkey and Schultz 1993)."""
    floating: Annotated[float, Meta(ge=-0.5, le=1.5)] = 0.0
    """Of the tilt, what surgery gives the lowest rib, which nothing ties to the sternum; ribs between it and the
    seventh take a part that grows downwards. No study of it was found. On seven bodies with curves as published,
    0.2 turns the back at L1 and L2 the wrong way by up to 1.6 degrees more than 0 does."""
    upper: Annotated[float, Meta(ge=-1.5, le=1.0)] = -1.0
    """Of the tilt, what the highest rib takes beside `lateral_bending`; ribs down to the seventh take a part that
    decreases downwards. A vertebra that tilts lifts one head of its ribs over the other; with -1 the outer ends of
    ribs 1 to 5 rise alike on both sides, as the muscles between neck and shoulders hold them. Patients' shoulders
    come from 7 mm to -1.6 mm (619 patients, mean curve 58 degrees), those of seven bodies from 7 to -4 where 65 %
    of a thoracic or double major curve is corrected."""
    shift: Annotated[float, Meta(ge=0.0, le=1.5)] = 1.0
    """Of the vertebra's sideways way, at the front ends of its ribs: the sideways offset of the cage follows Cobb
    (Closkey and Schultz 1993). What is missing turns a rib about its head."""
    reversible_part: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.4
    """Of `axial_rotation` and `lateral_bending`, what surgery takes back; the rest is bone that has grown. Heads
    of ribs go with the vertebrae, which alone makes half of the change of the hump. With 0.4 the hump decreases by
    0.58 of the part by which the Cobb angle does, as in patients (-41 % for -71 %, Mattila et al. 2013)."""
    derotation_transfer: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.3
    """Of the turn that screws force on a vertebra beyond what goes with the change of its curve: 5.6 degrees more
    of derotation at the same Cobb angle changed the rib hump by 0.4 (Tang et al. 2015, n = 81)."""
    scapula: Annotated[float, Meta(ge=0.0, le=1.0)] = 1.0
    """Of the motion of what lies under a shoulder blade of the ribs 2 to 7 of its side; no study was found. At 0.8
    it stays behind by up to 8 mm where ribs go 40 mm; at 0.5 it would cut into them."""

    def __post_init__(self) -> None:
        """Raises InputError for a share that no joint has."""
        check_fields(self, "rib shares")


LIMITS = bounds_of(RibCoupling)
"""Limits of the shares."""
RANGES = {
    "axial_rotation": (0.5, 0.8),
    "lateral_bending": (-0.1, 0.2),
    "floating": (-0.1, 0.1),
    "upper": (-1.3, -0.5),
    "shift": (0.9, 1.0),
    "reversible_part": (0.25, 0.55),
    "derotation_transfer": (0.1, 0.5),
    "scapula": (0.8, 1.0),
}
"""Ranges of the shares, one standard deviation of the studies to either side, for the bands (`run.sources`)."""
