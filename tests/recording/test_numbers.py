"""The table of the numbers now."""

from support.small_trunk import made_up_increments, measured, small_case
from warp_trunk.measures import measure
from warp_trunk.measures.rows import number
from warp_trunk.recording.numbers import table


def test_the_table_says_before_now_and_target():
    case, trunk = small_case()
    (increment,) = made_up_increments(trunk, count=1)
    now, before = measured(case, trunk, increment), measure(case.skin, case.landmarks_before)
    rows = table(before, now, before, "target", 1.0).splitlines()
    assert rows[0] == "|  | before | now, 100 % | target |"
    assert "| Rotation of the back (BSR), largest from T1 to T12 [°] | 0.0 | 12 right | 0.0 |" in rows
    assert f"| Movement of the skin, largest [mm] | – | {number(now.skin_change_max)} | – |" in rows
