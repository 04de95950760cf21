"""How sure the measures of the planned spine are, against draws of its landmarks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.phantoms import whole_phantom
from warp_trunk.case.uncertainty import Uncertainty
from warp_trunk.measures import cobb_angles
from warp_trunk.measures.cobb import curves_after
from warp_trunk.measures.sagittal import kyphosis
from warp_trunk.measures.spine import spine_of
from warp_trunk.run.bands import spine_bands
from warp_trunk.run.sources import Source

CASE = replace(whole_phantom(), uncertainty=Uncertainty(landmark_error=1.0, landmark_error_sd=0.7))
AFTER = CASE.planned_landmarks


def test_against_draws() -> None:
    bands, random = spine_bands(CASE, ()), np.random.default_rng(3)
    curves = cobb_angles(CASE.landmarks_before)
    assert {f"cobb_deg {curve.upper}-{curve.lower}" for curve in curves} <= bands.keys()
    assert {f"apical_rotation_deg {curve.apex}" for curve in curves} <= bands.keys()
    drawn = []
    for _ in range(1000):
        error = CASE.uncertainty.landmark_sd * random.standard_normal(AFTER.points.shape)
        marks = replace(AFTER, points=AFTER.points + error)
        drawn.append([*curves_after(curves, marks), kyphosis(spine_of(marks))["T5-T12"]])
    names = [*(f"cobb_deg {curve.upper}-{curve.lower}" for curve in curves), "kyphosis_deg T5-T12"]
    np.testing.assert_allclose(
        [bands[name].sd for name in names], np.std(np.array(drawn, dtype=np.float64), axis=0), rtol=0.08
    )
    before = [*curves_after(curves, AFTER), kyphosis(spine_of(AFTER))["T5-T12"]]
    assert [bands[name].value for name in names] == before


def test_a_missed_plan_is_a_change_of_its_landmarks() -> None:
    """A tenth of the whole correction less leaves a Cobb angle that is nearly a tenth of the correction larger."""
    certain = replace(CASE, uncertainty=Uncertainty(landmark_error=0.0, landmark_error_sd=0.0))
    move = 0.1 * (AFTER.points - CASE.landmarks_before.points)
    bands = spine_bands(certain, [Source("amount", "a tenth", "none", of_surgery=True, landmarks_after=move)])
    for curve, after in zip(
        cobb_angles(CASE.landmarks_before), curves_after(cobb_angles(CASE.landmarks_before), AFTER), strict=True
    ):
        assert after is not None
        sd = bands[f"cobb_deg {curve.upper}-{curve.lower}"].sd
        assert sd == pytest.approx(0.1 * abs(curve.angle - after), rel=0.2, abs=0.1)
