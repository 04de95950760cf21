"""The lines in which files of a case are refused: landmarks, case.toml, tissue.toml and thickness."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from support.refusals import refusal
from support.shown import check_shown
from warp_trunk.case.axes import Axes
from warp_trunk.case.header import read_header
from warp_trunk.case.landmarks import landmark_file, read_landmarks
from warp_trunk.case.layers import LayerTable, read_layers
from warp_trunk.case.points import read_followed_points
from warp_trunk.case.tissue_file import read_tissue_file


def markups(*points: tuple[str, Sequence[float]], **more: object) -> str:
    controls = [{"label": label, "position": place} for label, place in points]
    return json.dumps({"markups": [{"controlPoints": controls, **more}]})


def read_thickness(path: Path) -> None:
    read_layers(path.parent, LayerTable(fat_thickness=path.name), 1.0, 3)


POINT = ("a", [1, 2, 3])
FCSV = "# CoordinateSystem = LPS\n"
FILES: dict[str, tuple[Callable[[Path], object], list[str]]] = {
    "a.csv": (read_landmarks, [
        "x,y,name\n", "name,x,x,y,z\n", "", "name,x,y,z\n", "name,x,y,z\n,1,2,3\n", f"{'name' * 30},x,y,z\n",
        "name,x,y,z\nT1_a,1,2,3\n\nT1_a,4,5,6\n", f"name,x,y,z\na,1,2,{'3.' * 50}\n",
        "name,x,y,z\na,1,2,10000001\n", "name,x,y,z\na,1,2,-1e7\nb,-1.1e7,0,0\n", f"name,x,y,z\n{'ab' * 60},1\n",
        f"name,x,y,z\n{'ab' * 60}\x07,1,2,3\n", "name;x;y;z\na;1,5;2;3;4\n",
    ]),
    "a.mrk.json": (read_landmarks, [
        "[1]", markups(), markups(("", [1, 2, 3])), markups(("a", [1])), markups(("a", [1, 2, 1e8])),
        markups(POINT, coordinateSystem="IJK" * 20), markups(POINT, coordinateUnits="inch"),
        markups(POINT, coordinateUnits=["mm", "mm", "um"]),
    ]),
    "a.fcsv": (read_landmarks, [
        FCSV + "0,1,2,nan,0,0,0,1,1,1,0,a\n", FCSV + "0,1,2\n", FCSV + "# columns = id,x,label\n", "0,1,2,3\n",
        "# CoordinateSystem = 2\n0,1,2,3,0,0,0,1,1,1,0,a\n", FCSV + "0,1,2,3,0,0,0,1,1,1,0\n",
    ]),
    "points.csv": (lambda path: read_followed_points(path, Axes("LPS"), "mm"), ["name,x,y\n"]),
    "case.toml": (read_header, [
        'axis = "LPS"', "tissue = 1", "[tissue]\ntheta = true", "[tissue]\nepsilon = nan", 'units = "ft"',
        "[uncertainty]\ncobb = -1", "[study]\npose = 'lying'", "[study]\nmonths_after = -1",
        "landmark_columns = 3", "[study]\nvirtual = true\nsynthetic = true",
        "[layers]\nfat_thicknes = 1", "[layers.fat]\nthets = 1",
        "[layers]\nfat_thickness = true", "[layers.fat]\nyoungs_modulus = -3", 'posture = "sitting"',
        'axes = "LPSA"', 'landmark_columns = ["a", "b", "c", "a"]', "[invented]\nshare = 1.5",
        "[study]\nmonths_after = 1300", "[uncertainty]\nepsilon = 0.9", "[uncertainty]\nlandmark_error = 1001",
        "[ribs]\nreversible_part = 1.1", "notes = [1]",
    ]),
    "tissue.toml": (read_tissue_file, [
        "[tisue]", "[tissue]\npoisson_ratio = 0.5", "[ribs]\nreversible_part = '1'", "[ribs]\nturn = 0.5",
        "[layers.bone]\ndensity = 1", "[tissue]\nfat = 2", "density = 950",
    ]),
    "fat.txt": (read_thickness, ["1\n2\n", "1\ntwo\n3\n", "1\n-2\n3\n", "1\n200.5\n3\n"]),
}  # fmt: skip


def test_lines_of_broken_files_are_as_accepted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    lines = []
    for name, (read, texts) in FILES.items():
        for text in texts:
            Path(name).write_text(text, encoding="utf-8")
            lines.append(refusal(f"{text[:100]!r}", tmp_path, lambda read=read, name=name: read(Path(name))))
    Path("a.mrk.json").write_text("", encoding="utf-8")
    lines.append(refusal("two files of landmarks", tmp_path, lambda: landmark_file(tmp_path, "a")))
    check_shown("refused_files", lines)
