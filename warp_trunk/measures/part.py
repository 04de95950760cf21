"""Measures of any part of the body, with a spine or without: the change of the skin, and its error."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from warp_trunk.engine.trunk_mesh import tet_volumes
from warp_trunk.geometry.normals import area_vectors, corner_areas

from .skin_distance import same_skin

if TYPE_CHECKING:
    from warp_trunk.engine.trunk_mesh import TrunkMesh
    from warp_trunk.geometry.surface import Surface

NEAR = 2.0
"""Studies of the face report the share of the skin that is predicted nearer than this [mm]."""


def swept_volumes(before: Surface, after: Surface) -> tuple[float, float]:
    """Volumes between two skins of the same triangles, outside the first and inside it [cm3], both positive.

    Each triangle sweeps the integral of mean displacement times area vector over its straight way; the area vector
    is quadratic in it, so that Simpson's rule is exact. Outward less inward is the change of the enclosed volume.
    """
    way = after.vertices - before.vertices
    areas = [area_vectors(before.vertices + part * way, before.faces) for part in (0.0, 0.5, 1.0)]
    mean = (areas[0] + 4.0 * areas[1] + areas[2]) / 6.0
    swept = np.einsum("fi,fi->f", way[before.faces].mean(axis=1), mean) / 1000.0
    return float(swept[swept > 0.0].sum()), float(-swept[swept < 0.0].sum())


def agreement(predicted: Surface, actual: Surface) -> tuple[dict[str, float], np.ndarray]:
    """Distance of a predicted skin from the actual one, by area; cut planes are left out.

    Returns:
        By name, the share of the skin nearer than `NEAR` [%], the mean distance, the distance than which 95 % of
        the skin is nearer, and the largest distance [mm]; and the signed distance of each vertex, positive outside
        the actual skin, NaN where it has no counterpart, shape (vertices,).
    """
    signed, counted = same_skin(predicted, actual)
    size, area = np.abs(signed)[counted], corner_areas(predicted)[counted]
    found = {
        "distance_within_2_mm_percent": 100.0 * float(area[size <= NEAR].sum() / area.sum()),
        "distance_mean_mm": float(np.average(size, weights=area)),
        "distance_p95_mm": float(np.quantile(size, 0.95, weights=area, method="inverted_cdf")),
        "distance_maximum_mm": float(size.max()),
    }
    return found, np.where(counted, signed, np.nan)


def agreement_rows(agreed: Mapping[str, float]) -> list[list[str]]:
    """The numbers of `agreement` as rows of a table."""
    return [
        [f"Skin nearer than {NEAR:g} mm [%]", f"{agreed['distance_within_2_mm_percent']:.0f}"],
        ["Mean distance [mm]", f"{agreed['distance_mean_mm']:.2f}"],
        ["95 % of the skin is nearer than [mm]", f"{agreed['distance_p95_mm']:.2f}"],
        ["Largest distance [mm]", f"{agreed['distance_maximum_mm']:.2f}"],
    ]


def tissue_volume_change(trunk: TrunkMesh, displacement: np.ndarray) -> float:
    """How much the soft tissue as a whole has grown [%], negative where it shrank.

    Soft tissue is nearly incompressible, so a simulation that changes its volume by percents is not to be
    trusted there. An inverted tetrahedron counts as negative.

    Args:
        trunk: the mesh between bones and skin.
        displacement: of its nodes [mm], shape (nodes, 3).
    """
    before = tet_volumes(trunk.nodes, trunk.tets).sum()
    after = tet_volumes(trunk.nodes + displacement, trunk.tets).sum()
    return 100.0 * (float(after / before) - 1.0)
