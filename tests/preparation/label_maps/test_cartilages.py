"""One label of all costal cartilages, separated: on tubes whose owners are known."""

from __future__ import annotations

import numpy as np
import pytest

from warp_trunk.preparation.label_maps.cartilages import split_cartilages
from warp_trunk.preparation.label_maps.mask import Mask

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


class Drawing:
    """Tubes on one grid of voxels."""

    def __init__(self, spacing: tuple[float, float, float], turn: np.ndarray) -> None:
        self.affine = np.eye(4)
        self.affine[:3, :3] = turn * np.array(spacing)
        low, high = np.array([-185.0, -10.0, -95.0]), np.array([185.0, 30.0, 90.0])
        corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
        own = corners @ np.linalg.inv(self.affine[:3, :3]).T
        self.affine[:3, 3] = self.affine[:3, :3] @ np.floor(own.min(axis=0))
        i, j, k = (np.ceil(np.ptp(own, axis=0)).astype(int) + 1).tolist()
        self.shape = (i, j, k)
        self.points = np.argwhere(np.ones(self.shape)) @ self.affine[:3, :3].T + self.affine[:3, 3]

    def mask(self, inside: np.ndarray) -> Mask:
        whole = Mask(inside.reshape(self.shape), (0, 0, 0), self.affine, self.shape)
        part = whole.part(whole.inside)
        assert part is not None
        return part

    def sternum(self) -> Mask:
        x, y, z = np.abs(self.points.T)
        return self.mask((x < 12.0) & (y < 6.0) & (self.points[:, 2] > 30.0) & (z < 85.0))


def right_share(split: dict[str, Mask], drawing: Drawing, lines: Lines, sure: np.ndarray) -> dict[str, float]:
    """For each cartilage, how much of what is surely its own it was given."""
    numbers = np.arange(len(drawing.points)).reshape(drawing.shape)
    owner = np.full(len(drawing.points), "", dtype="U8")
    for name, mask in split.items():
        box = tuple(slice(a, a + n) for a, n in zip(mask.first, mask.inside.shape, strict=True))
        owner[numbers[box][mask.inside]] = name[-8:].lstrip("_e")
    names = list(lines)
    distances = np.stack([away(drawing.points, line) for line in lines.values()])
    true = distances.argmin(axis=0)
    return {name: float(np.mean(owner[sure & (true == number)] == name)) for number, name in enumerate(names)}


@pytest.mark.parametrize(
    ("spacing", "turn"), [((2.0, 2.0, 2.0), np.eye(3)), ((0.9, 2.0, 3.0), np.diag([-1.0, 1.0, 1.0]))]
)
def test_joined_cartilages_go_to_their_ribs(spacing, turn):
    drawing = Drawing(spacing, turn)
    cartilages, ribs = cage()
    distances = np.stack([away(drawing.points, line) for line in cartilages.values()])
    inside = distances.min(axis=0) < RADIUS
    bridges = [np.array([[s * 40.0, 0.0, 25.0], [s * 40.0, 0.0, 60.0]]) for s in SIDES.values()]  # 6 with 7
    for bridge in bridges:
        inside |= away(drawing.points, bridge) < 4.0
    bones = {
        f"rib_{name}": drawing.mask((away(drawing.points, line) < RADIUS) & ~inside) for name, line in ribs.items()
    }
    split, lost = split_cartilages(drawing.mask(inside), bones, drawing.sternum())
    assert set(split) == {f"costal_cartilage_{name}" for name in cartilages}
    assert lost == 0.0
    near = np.sort(distances, axis=0)
    sure = (near[0] < RADIUS) & (near[1] > near[0] + 4.0)  # neither where two join, nor in a bridge
    shares = right_share(split, drawing, cartilages, sure)
    assert min(share for name, share in shares.items() if int(name[-2:]) <= 7) > 0.95, shares
    for name, line in cartilages.items():  # 8 to 10 are soon joined with the one above
        points = split[f"costal_cartilage_{name}"].points()
        assert np.linalg.norm(points - line[0], axis=1).min() < RADIUS, name
        assert np.median(away(points, line)) < RADIUS, name
    assert sum(np.count_nonzero(mask.inside) for mask in split.values()) == np.count_nonzero(inside)
