import numpy as np
import pytest

from warp_trunk.case.landmarks import Landmarks, bone_of, read_landmarks, write_landmarks
from warp_trunk.errors import InputError

NAMES = (
    "L1_left_pedicle_superior",
    "T10_x",
    "T2_x",
    "asis_left",
    "asis_right",
    "T1_x",
    "T10_y",
    "rib_left_01_tip",
)


def make(names=NAMES):
    return Landmarks(names, np.random.default_rng(0).normal(size=(len(names), 3)) * 1e3 / 3.0)


def test_round_trip_keeps_every_bit(tmp_path):
    landmarks = make()
    landmarks.points[0] = [0.1 + 0.2, -1e-300, 9999999.999999998]
    write_landmarks(tmp_path / "a.csv", landmarks)
    back = read_landmarks(tmp_path / "a.csv")
    assert back.names == landmarks.names
    np.testing.assert_array_equal(back.points, landmarks.points)
    assert (tmp_path / "a.csv").read_text().startswith("name,x,y,z\nL1_left_pedicle_superior,0.30000000000000004,")


def test_reads_what_spreadsheets_write(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"\xef\xbb\xbfname, x,y,z\r\n T7_a , 1,2.5,-3e1\r\n,,,\r\n\r\n")
    back = read_landmarks(tmp_path / "a.csv")
    assert back.names == ("T7_a",)
    np.testing.assert_array_equal(back.points, [[1.0, 2.5, -30.0]])


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("x,y,name\n", "the first line must name the columns name,x,y,z once each, not x,y,name"),
        ("name,x,x,y,z\n", "once each, not name,x,x,y,z"),
        ("", "the first line must name the columns name,x,y,z once each, not an empty file"),
        ("name,x,y,z\n", "there is no landmark in it"),
        ("name,x,y,z\nT1_a,1,2\n", "line 2: a landmark is name,x,y,z, not 'T1_a,1,2'"),
        ("name,x,y,z\n,1,2,3\n", "line 2: a landmark is name,x,y,z, not ',1,2,3'"),
        ("name,x,y,z\nT1_a,1,2,3\n\nT1_a,4,5,6\n", "line 4: 'T1_a' stands in line 2 already"),
        ("name,x,y,z\nT1_a,1,2,three\n", "line 2: z of 'T1_a' must be a number, not 'three'"),
        ("name,x,y,z\nT1_a,1,nan,3\n", "line 2: y of 'T1_a' must be finite and within 1e+07, not nan"),
        ("name,x,y,z\nT1_a,-inf,2,3\n", "line 2: x of 'T1_a' must be finite and within 1e+07, not -inf"),
    ],
)
def test_bad_files_are_refused(tmp_path, text, rule):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputError) as error:
        read_landmarks(tmp_path / "bad.csv")
    assert "bad.csv" in str(error.value)
    assert rule in str(error.value)


def test_missing_and_binary_files_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.csv: there is no such file"):
        read_landmarks(tmp_path / "nowhere.csv")
    (tmp_path / "bad.csv").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(InputError, match=r"bad\.csv: is no text in UTF-8"):
        read_landmarks(tmp_path / "bad.csv")


def test_vertebrae_stand_top_to_bottom():
    assert make().vertebrae() == ("T1", "T2", "T10", "L1")


def test_landmarks_of_a_bone_keep_their_rows():
    landmarks = make()
    part = landmarks.of_bone("T10")
    assert part.names == ("T10_x", "T10_y")
    np.testing.assert_array_equal(part.points, landmarks.points[[1, 6]])
    assert landmarks.of_bone("T1").names == ("T1_x",)
    assert landmarks.of_bone("hip_left").names == ("asis_left",)
    assert landmarks.of_bone("sacrum").points.shape == (0, 3)


def test_bone_of_takes_the_longest_name():
    bones = ("rib", "rib_left_01", "hip_right", "T1")
    assert bone_of("rib_left_01_tip", bones) == "rib_left_01"
    assert bone_of("asis_right", bones) == "hip_right"
    assert bone_of("asis_left", bones) is None
    assert bone_of("T10_x", bones) is None


def test_index_names_the_nearest():
    landmarks = make()
    assert landmarks.index("T2_x") == 2
    np.testing.assert_array_equal(landmarks.point("T2_x"), landmarks.points[2])
    with pytest.raises(
        InputError, match=r"no 'L1_left_pedicel_superior'.*did you mean 'L1_left_pedicle_superior'"
    ):
        landmarks.index("L1_left_pedicel_superior")


def test_names_and_points_must_fit():
    with pytest.raises(InputError, match="'a' is named more than once"):
        Landmarks(("a", "b", "a"), np.zeros((3, 3)))
    with pytest.raises(InputError, match=r"must have shape \(2, 3\)"):
        Landmarks(("a", "b"), np.zeros((3, 3)))
