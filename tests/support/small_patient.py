"""A patient of a few hundred tetrahedra with a whole, curved spine, ready for any plan at once."""

from dataclasses import replace
from typing import Any

from support.known_spine import known_spine
from support.small_trunk import small_trunk
from warp_trunk.case import Case
from warp_trunk.geometry.surface import Surface
from warp_trunk.run.options import RunOptions
from warp_trunk.run.patient import PreparedPatient, patient_of

APEX = "T7"
"""Of its right thoracic curve of 40 degrees, T4 to T11."""


def curved_case() -> Case:
    """A box of tissue with the landmarks of a curved spine; of its bones only a vertebra and a rib are drawn."""
    _, skin = small_trunk()
    before = known_spine(
        {"T4": -20.0, "T11": 20.0, "L5": 0.0}, {"T1": 25.0, "T12": -15.0}, {"T8": 15.0, "L2": 0.0}
    )
    bones = {
        name: Surface(skin.vertices * 0.05 + [0.0, 20.0, height], skin.faces)
        for name, height in (("T8", 200.0), ("rib_left_08", 180.0))
    }
    return Case('curved "<i>box</i>"', skin, bones, before)


def small_patient(**options: Any) -> PreparedPatient:
    """It, made ready on one CPU thread."""
    trunk = replace(small_trunk()[0], bone_names=("T8",))
    return patient_of(curved_case(), RunOptions(device="cpu", threads=1, **options), trunk)
