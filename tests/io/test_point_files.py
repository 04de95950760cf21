"""Texts of points as scanners and spreadsheets write them."""

import numpy as np
import pytest

from support.refusals import refusal
from support.shown import check_shown
from warp_trunk.io.point_files import read_points

POINTS = np.array([[283.01, -1171.53, 12.5], [1.5, 2.25, -3.0]])
TEXTS = {
    "semicolons and decimal commas": "283,01;-1171,53;12,5\n1,5;2,25;-3\n",
    "blanks and decimal commas": "283,01 -1171,53 12,5\n1,5 2,25 -3,0\n",
    "tabs, decimal commas and colours": "283,01\t-1171,53\t12,5\t7\n1,5\t2,25\t-3,0\t255\n",
    "commas": "x,y,z\n283.01,-1171.53,12.5\n1.5,2.25,-3.0\n",
    "commas and blanks": "283.01, -1171.53, 12.5\n1.5, 2.25, -3.0\n",
    "semicolons": "283.01;-1171.53;12.5\n1.5;2.25;-3.0\n",
    "y before x": "y,x,z\n-1171.53,283.01,12.5\n2.25,1.5,-3.0\n",
    "other columns first": "id;time;Z [mm];X [mm];Y [mm]\n1;0,5;12,5;283,01;-1171,53\n2;0,6;-3,0;1,5;2,25\n",
    "numbers in quotes": '"x","y","z"\n"283.01","-1171.53","12.5"\n"1,5","2,25","-3"\n',
    "an index without a title": ",x,y,z\n0,283.01,-1171.53,12.5\n1,1.5,2.25,-3.0\n",
    "an empty column": "a;x;y;z\n;283,01;-1171,53;12,5\n;1,5;2,25;-3\n",
    "titles in a comment": "# z x y\n12.5 283.01 -1171.53\n-3.0 1.5 2.25\n",
    "a mark of the byte order": "\ufeff283.01 -1171.53 12.5\n1.5 2.25 -3.0\n",
    "a title that names no columns": "scan of a back\n283.01 -1171.53 12.5\n1.5 2.25 -3.0\n",
}


@pytest.mark.parametrize("kind", TEXTS)
def test_a_text_of_points_is_read_by_its_columns(tmp_path, kind):
    (tmp_path / "back.xyz").write_text(TEXTS[kind], encoding="utf-8")
    np.testing.assert_array_equal(read_points(tmp_path / "back.xyz"), POINTS)


BROKEN = (
    "x,y,depth\n1,2,3\n", "x,x,y\n1,2,3\n",
    "1 2\n3 4\n", "1 2 3\nfour 5 6\n", "1_0 2 3\n", "1 2\n", "1 2 nan\n", "",
)  # fmt: skip


def test_lines_of_texts_that_hold_no_points_are_as_accepted(tmp_path):
    lines = []
    for text in BROKEN:
        (tmp_path / "back.csv").write_text(text, encoding="utf-8")
        lines.append(refusal(repr(text), tmp_path, lambda: read_points(tmp_path / "back.csv")))
    check_shown("refused_points", lines)
