"""The table of the numbers now."""

from support.small_trunk import made_up_increments, measured, small_case
from warp_trunk.measures import measure
from warp_trunk.recording.numbers import table


def test_the_table_says_before_now_and_target():
    case, trunk = small_case()
    (increment,) = made_up_increments(trunk, count=1)
    now, before = measured(case, trunk, increment), measure(case.skin, case.landmarks_before)
    rows = table(before, now, before, "target", 1.0).splitlines()
    assert "| Back rotation, thoracic | +0.0° | +12.0° | +0.0° |" in rows
    assert f"| Skin moved by up to |  | {now.skin_change_max:.1f} mm |  |" in rows
