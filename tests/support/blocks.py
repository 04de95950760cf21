"""Bones built of blocks: shapes whose landmarks are known."""

from functools import cache

import numpy as np

from warp_trunk.case.anatomy import VERTEBRAE
from warp_trunk.case.landmarks import VERTEBRA_POINTS, Landmarks
from warp_trunk.geometry.surface import Surface

Box = tuple[tuple[int, int, int], tuple[int, int, int]]
"""Lowest and highest corner [mm], even numbers."""

VERTEBRA: tuple[Box, ...] = (
    ((-16, -60, 0), (16, -30, 20)),  # body
    ((8, -30, 10), (14, -18, 18)),  # left pedicle
    ((-14, -30, 10), (-8, -18, 18)),  # right pedicle
    ((-14, -18, 6), (14, -12, 18)),  # arch
    ((-4, -12, -8), (4, 6, 12)),  # spinous process
    ((14, -18, 10), (34, -12, 16)),  # transverse processes
    ((-34, -18, 10), (-14, -12, 16)),
)
HIP: tuple[Box, ...] = (
    ((20, -100, 0), (60, -20, 40)),  # pubis, further forward than the crest
    ((60, -60, 0), (80, 0, 60)),
    ((80, -80, 40), (120, 0, 160)),  # wing
)


@cache
def blocks(boxes: tuple[Box, ...]) -> Surface:
    """The closed surface of a union of boxes, from the faces between filled and empty cells of 2 mm."""
    low = np.array([box[0] for box in boxes]).min(axis=0) - 2
    high = np.array([box[1] for box in boxes]).max(axis=0) + 2
    filled = np.zeros((high - low) // 2, dtype=bool)
    for lower, upper in boxes:
        filled[tuple(slice((a - o) // 2, (b - o) // 2) for a, b, o in zip(lower, upper, low, strict=True))] = True
    quads = []
    for axis in range(3):
        u, v = (np.eye(3, dtype=int)[(axis + k) % 3] for k in (1, 2))
        step = np.diff(filled.astype(int), axis=axis)
        for sign in (1, -1):
            corner = np.argwhere(step == -sign) + np.eye(3, dtype=int)[axis]
            turn = (0 * u, u, u + v, v) if sign > 0 else (0 * u, v, u + v, u)
            quads.append(np.stack([corner + offset for offset in turn], axis=1))
    corners = np.concatenate(quads)
    nodes, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    square = index.reshape(-1, 4)
    faces = np.concatenate([square[:, [0, 1, 2]], square[:, [0, 2, 3]]])
    return Surface(2.0 * nodes + low, faces.astype(np.int32))


def moved(surface: Surface, rotation: np.ndarray, shift: list[float]) -> Surface:
    return Surface(surface.vertices @ rotation.T + shift, surface.faces)


def skeleton() -> dict[str, Surface]:
    hip, vertebra = blocks(HIP), blocks(VERTEBRA)
    mirrored = Surface(hip.vertices * [-1.0, 1.0, 1.0], hip.faces[:, ::-1])
    return {"hip_left": hip, "hip_right": mirrored, "T7": moved(vertebra, np.eye(3), [0.0, 0.0, 500.0])}


def spine_and_hips() -> dict[str, Surface]:
    """Hip bones and all vertebrae, small enough for the skin of the phantom."""
    hips = {
        name: moved(bone, 0.8 * np.eye(3), [0.0, 20.0, 0.0]) for name, bone in skeleton().items() if name != "T7"
    }
    vertebra = blocks(VERTEBRA)
    spine = {
        bone: moved(vertebra, 0.8 * np.eye(3), [0.0, 50.0, 440.0 - 20.0 * i]) for i, bone in enumerate(VERTEBRAE)
    }
    return {**hips, **spine}


def known_landmarks() -> Landmarks:
    """Those of the vertebrae of `spine_and_hips`; pedicles are as wide and high wherever they are cut."""
    six = np.array([[0, -45, 20], [0, -45, 0], [11, -29, 18], [11, -29, 10], [-11, -29, 18], [-11, -29, 10]])
    points = [0.8 * six + [0.0, 50.0, 440.0 - 20.0 * i] for i in range(len(VERTEBRAE))]
    return Landmarks(tuple(f"{b}_{p}" for b in VERTEBRAE for p in VERTEBRA_POINTS), np.vstack(points))
