"""Plans side by side: what the page shows, what it says that differs, and which plans it refuses to compare."""

import math
import re

import pytest

from support.known_spine import known_spine
from support.report_results import write_small_result
from support.trunk_shapes import flat_back, rotation, tube
from warp_trunk.cli import main
from warp_trunk.errors import InputError
from warp_trunk.measures import measure
from warp_trunk.report.plans import differences
from warp_trunk.report.style import BEFORE, PLANS, TrunkState
from warp_trunk.report.writing import write_comparison
from warp_trunk.results import read_result

CURVE = {"T1": 28.0, "T5": 30.0, "T12": -30.0, "L5": -28.0}


def pose(look, share, turn):
    """A trunk turned by an angle, and a spine with a share of a curve of 60 degrees."""
    spine = known_spine(to_left={level: share * tilt for level, tilt in CURVE.items()})
    skin = tube(flat_back() @ rotation(-turn).T, bottom=-80.0, top=440.0)
    return TrunkState(look, skin, spine, measure(skin, spine))


@pytest.fixture(scope="module")
def three():
    return pose(BEFORE, 1.0, 12.0), [pose(PLANS[0], 0.3, 7.0), pose(PLANS[1], 0.5, 6.0)]


def test_what_differs_is_told_with_each_plan_and_the_rest_is_alike(three):
    told = differences(*three)
    assert "Cobb angle T5 to T12: 18° with plan A and 30° with plan B." in told
    *_, alike = told
    assert alike.startswith("Too alike to choose by, within 5° of the spine, 2.5° of the back and 5 mm: ")
    assert "rotation of the upper back" in alike  # 7 and 6 degrees
    assert "Cobb" not in alike
    apart = next(line for line in told if line.startswith("The predicted skins"))
    most, mean = map(int, re.findall(r"(\d+) mm", apart))
    assert most == round(math.hypot(150.0, 100.0) * math.radians(1.0))  # its corners, turned by one degree
    assert 0 < mean <= most


def test_page_holds_every_plan_and_nothing_from_outside(tmp_path, capsys):
    folders = [write_small_result(tmp_path / name, name=f"<b>{name}</b>") for name in ("first", "second")]
    (folders[1] / "plan.toml").write_text('uiv = "T4"  # <i>\n')
    assert main(["report", *map(str, folders)]) == 0
    page = tmp_path / "plans.html"
    assert str(page) in capsys.readouterr().out
    text = page.read_text()
    assert "&lt;b&gt;first&lt;/b&gt;" in text
    assert text.count("# &lt;i&gt;") == 1  # by which plan it was made
    assert "http" not in re.sub(r'base64,[^"]*|plain">[^<]*', "", text).replace("http-equiv", "")
    assert text.count("<img") == 5
    assert sorted(path.stem for path in (tmp_path / "plans").iterdir()) == [
        "back", "hump", "rotation", "spine_behind", "spine_side",
    ]  # fmt: skip
    assert "Too alike to choose by" in text


def test_another_patient_a_plan_given_twice_and_too_many_are_refused(tmp_path):
    one, other = write_small_result(tmp_path / "one"), write_small_result(tmp_path / "other", without="T8")
    with pytest.raises(InputError, match=r"other: skin and landmarks before surgery must be those of .*one"):
        write_comparison([read_result(one), read_result(other)])
    with pytest.raises(InputError, match="is given twice"):
        write_comparison([read_result(one)] * 2)
    with pytest.raises(InputError, match="from 2 to 4 results"):
        write_comparison([read_result(one)] * 5)
