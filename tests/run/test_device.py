"""Every kernel of a simulation runs on the device that was asked for, and on no other."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest
import warp as wp

from support.small_trunk import small_case
from warp_trunk.engine.parallel import choose_device
from warp_trunk.engine.simulation import SimulationOptions
from warp_trunk.run.options import RunOptions
from warp_trunk.run.prediction import prepare


@pytest.fixture
def devices_used(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """The devices of all launches, as they are made."""
    used: set[str] = set()
    launch = wp.launch

    def note(*arguments: Any, device: Any = None, **others: Any) -> Any:
        used.add(str(wp.get_device(device)))
        return launch(*arguments, device=device, **others)

    monkeypatch.setattr(wp, "launch", note)
    return used


def end(device: str, bones: Literal["follow", "spline"]) -> np.ndarray:
    """Where a small trunk ends, prepared and simulated on a device [mm]; its bone has landmarks of its own."""
    case, trunk = small_case()
    case, trunk = replace(case, bones={"T8": case.bones["T10"]}), replace(trunk, bone_names=("T8",))
    options = RunOptions(bones=bones, device=device, simulation=SimulationOptions(increments=2))
    prediction = prepare(case, options, trunk)
    assert prediction.model.device == device
    return prediction.relax().last.displacement


@pytest.mark.skipif("cpu" not in map(str, wp.get_devices()), reason="Warp has no CPU device on this machine")
@pytest.mark.parametrize("bones", ["follow", "spline"])
def test_the_cpu_is_taken_beside_a_cuda_device(
    bones: Literal["follow", "spline"], monkeypatch: pytest.MonkeyPatch, devices_used: set[str]
) -> None:
    """Where there is a CUDA device, which `auto` would take, `cpu` gives the bits of a machine without one."""
    alone = end("cpu", bones)
    monkeypatch.setattr(wp, "is_cuda_available", lambda: True)
    monkeypatch.setattr(wp, "get_devices", lambda: ["cpu", "cuda:0"])
    assert choose_device("auto") == "cuda:0"
    devices_used.clear()
    np.testing.assert_array_equal(end("cpu", bones), alone)
    assert devices_used == {"cpu"}


@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device on this machine")
@pytest.mark.parametrize("bones", ["follow", "spline"])
def test_cuda_is_taken_where_it_is_asked_for(bones: Literal["follow", "spline"], devices_used: set[str]) -> None:
    end("cuda:0", bones)
    assert devices_used == {"cuda:0"}
