"""Fields between plans that are known."""

import numpy as np

from warp_trunk.live.image import MOST, Forecast

REST = np.random.default_rng(1).normal(size=(40, 3))
WAY, BESIDE = np.random.default_rng(2).normal(size=(2, 40, 3))
SHAPE, CURVED = np.random.default_rng(3).normal(size=(2, 9, 3))


def known(*at: float) -> Forecast:
    """Plans along one slider; the field grows straight along it, and with the square of it."""
    forecast = Forecast(REST, np.zeros((9, 3)))
    for share in at:
        forecast.learn(REST + share * WAY, field(share))
    return forecast


def field(share: float) -> np.ndarray:
    return share * SHAPE + 0.01 * share**2 * CURVED


def test_a_known_plan_is_met_and_the_next_is_straight_on() -> None:
    forecast = known(4.0, 8.0)
    assert forecast.way(REST + 8.0 * WAY) == 0.0
    np.testing.assert_allclose(forecast.at(REST + 8.0 * WAY), field(8.0), atol=1e-12)
    off = np.abs(forecast.at(REST + 9.0 * WAY) - field(9.0)).max()
    assert off < 0.15 * np.abs(field(9.0) - field(8.0)).max()


def test_beside_the_slider_it_is_the_nearest() -> None:
    """A direction without information from known plans changes nothing."""
    side = BESIDE - WAY * np.vdot(BESIDE, WAY) / np.vdot(WAY, WAY)
    found = known(4.0, 8.0).at(REST + 8.0 * WAY + 0.1 * side)
    np.testing.assert_allclose(found, field(8.0), atol=1e-9)


def test_a_plan_that_is_as_good_as_known_takes_its_place() -> None:
    """Two that differ by less than they are sure of would differ by their errors alone."""
    forecast = known(4.0)
    forecast.learn(REST + 4.01 * WAY, field(4.0) + 0.3)
    found = forecast.at(REST + 5.0 * WAY)
    assert np.abs(found - field(5.0)).max() < 0.6


def test_of_many_those_are_kept_that_stand_apart() -> None:
    """A slow drag does not push out what is known of plans far from it."""
    forecast = known(30.0, *np.arange(2.0, 20.0, 0.5))
    for share in (0.0, 30.0, 19.5):
        assert forecast.way(REST + share * WAY) == 0.0
    missing = [forecast.way(REST + share * WAY) > 0.0 for share in np.arange(2.0, 20.0, 0.5)]
    assert len(missing) - sum(missing) == MOST - 2
