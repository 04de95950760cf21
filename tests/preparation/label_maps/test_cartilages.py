"""One label of all costal cartilages, separated: on tubes whose owners are known."""

import numpy as np
import pytest

from support.label_maps import Voxels
from warp_trunk.preparation.label_maps.cartilages import split_cartilages

RADIUS = 6.0
SIDES = {"left": 1.0, "right": -1.0}
Lines = dict[str, np.ndarray]


def cage() -> tuple[Lines, Lines]:
    """Centre lines of cartilages and of the front parts of their ribs [mm]: 5 to 7 reach the sternum, the others
    the cartilage above, at a third of it."""
    cartilages: Lines = {}
    ribs: Lines = {}
    for side, sign in SIDES.items():
        for number in range(5, 11):
            name = f"{side}_{number:02d}"
            notch = np.array([18.0, 0.0, 170.0 - 19.0 * number])
            tip = np.array([45.0 + 8.0 * number, 0.0, notch[2] - 9.0 * max(0, number - 4)])
            if number > 7:
                above = cartilages[f"{side}_{number - 1:02d}"] * [sign, 1.0, 1.0]
                tip, notch = above[0] + [10.0, 0.0, -30.0], 0.65 * above[0] + 0.35 * above[1]
            cartilages[name] = np.array([tip, notch]) * [sign, 1.0, 1.0]
            ribs[name] = (tip + np.array([[13.0, 0.0, 0.0], [40.0, 20.0, 8.0]])) * [sign, 1.0, 1.0]
    return cartilages, ribs


def away(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Distance of points from a line between two [mm]."""
    start, along = line[0], line[1] - line[0]
    share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(points - start - share[:, None] * along, axis=1)


@pytest.mark.parametrize(
    ("spacing", "turn"), [((2.0, 2.0, 2.0), np.eye(3)), ((0.9, 2.0, 3.0), np.diag([-1.0, 1.0, 1.0]))]
)
def test_joined_cartilages_go_to_their_ribs(spacing, turn):
    drawing = Voxels(np.array([-185.0, -10.0, -95.0]), np.array([185.0, 30.0, 90.0]), spacing, turn)
    cartilages, ribs = cage()
    inside = np.min([away(drawing.points, line) for line in cartilages.values()], axis=0) < RADIUS
    for s in SIDES.values():  # bridges from 6 to 7
        inside |= away(drawing.points, np.array([[s * 40.0, 0.0, 25.0], [s * 40.0, 0.0, 60.0]])) < 4.0
    bones = {
        f"rib_{name}": drawing.mask((away(drawing.points, line) < RADIUS) & ~inside) for name, line in ribs.items()
    }
    x, y, z = drawing.points.T
    sternum = drawing.mask((np.abs(x) < 12.0) & (np.abs(y) < 6.0) & (z > 30.0) & (z < 85.0))
    split, lost = split_cartilages(drawing.mask(inside), bones, sternum)
    assert set(split) == {f"costal_cartilage_{name}" for name in cartilages}
    assert lost == 0.0
    assert sum(np.count_nonzero(mask.inside) for mask in split.values()) == np.count_nonzero(inside)
    distances = np.stack([away(drawing.points, line) for line in cartilages.values()])
    near = np.sort(distances, axis=0)
    sure = (near[0] < RADIUS) & (near[1] > near[0] + 4.0)  # neither where two join, nor in a bridge
    for number, (name, line) in enumerate(cartilages.items()):
        mask = split[f"costal_cartilage_{name}"]
        if int(name[-2:]) <= 7:
            assert mask.holds(drawing.points[sure & (distances.argmin(axis=0) == number)]).mean() > 0.95, name
        else:  # soon joined with the one above
            assert np.linalg.norm(mask.points() - line[0], axis=1).min() < RADIUS, name
            assert np.median(away(mask.points(), line)) < RADIUS, name
