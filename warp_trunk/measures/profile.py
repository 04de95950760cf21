"""The profile of a face: angles at nose and chin, and the lips against the line from nose to chin."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

ANGLES = {
    "Nasolabial angle [°]": ("columella", "subnasale", "upper_lip"),
    "Mentolabial angle [°]": ("lower_lip", "mentolabial_fold", "chin"),
}
"""Each with its first point, its corner and its last point (Legan and Burstone 1980)."""
LINE = ("nose_tip", "chin")
"""The ends of the E-line (Ricketts 1957)."""


def profile(places: Mapping[str, np.ndarray]) -> dict[str, float]:
    """The measures whose points are there: angles, and how far lips are in front of the E-line, from the side.

    Args:
        places: points by name, in LPS [mm], shape (3,) each.
    """
    found = {}
    for name, corners in ANGLES.items():
        if places.keys() >= set(corners):
            first, corner, last = (places[point] for point in corners)
            one, other = first - corner, last - corner
            found[name] = math.degrees(math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other)))
    if places.keys() >= set(LINE):
        (_, back, up), tip = places[LINE[1]] - places[LINE[0]], places[LINE[0]]
        for lip in {"upper_lip", "lower_lip"} & places.keys():
            _, behind, above = places[lip] - tip
            found[f"{lip} in front of the E-line [mm]"] = float(behind * up - above * back) / math.hypot(back, up)
    return dict(sorted(found.items()))
