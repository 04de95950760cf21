"""[layers] in case.toml and the files it names."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.asserting import refuses, there
from support.small_case import small_case
from warp_trunk.case import read_case, write_case
from warp_trunk.case.header import CaseHeader, header_text, read_header
from warp_trunk.case.layers import Constants, Layers, LayerTable, read_layers


def read(folder: Path, text: str) -> LayerTable | None:
    path = folder / "case.toml"
    path.write_text(text, encoding="utf-8")
    return read_header(path).layers


def test_a_case_without_the_table_has_no_layers(tmp_path: Path) -> None:
    assert read(tmp_path, "") is None
    assert read(tmp_path, "[layers]") == LayerTable()


def test_the_text_reads_back(tmp_path: Path) -> None:
    table = LayerTable(
        skin_thickness=2.1,
        fat_thickness='fat "1".txt',
        mesh="labels.vtu",
        fat=Constants(density=0.1 + 0.2),
        muscle=Constants(theta=3.0),
    )
    assert read(tmp_path, header_text(CaseHeader(name="a", layers=table))) == table


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("fat_thicknes = 1", "unknown key 'layers.fat_thicknes' (did you mean 'layers.fat_thickness'?"),
        ("fat_thickness = true", "'layers.fat_thickness' must be a number or a text, not True"),
        (
            "[layers.fat]\nyoungs_modulus = -3",
            "'youngs_modulus' must be a finite number of at least 1e-09, not -3.0",
        ),
    ],
)
def test_bad_tables_are_refused(tmp_path: Path, text: str, rule: str) -> None:
    with refuses(rule, begins=f"{tmp_path / 'case.toml'}: "):
        read(tmp_path, "[layers]\n" + text)


def test_thickness_is_in_the_unit_of_the_case_and_the_default_in_mm(tmp_path: Path) -> None:
    (tmp_path / "fat.txt").write_text("# over the back\n0.5\n0.6 # here\n0.7\n", encoding="utf-8")
    layers = read_layers(tmp_path, LayerTable(fat_thickness="fat.txt"), 10.0, 3)
    np.testing.assert_allclose(layers.fat_thickness, [5.0, 6.0, 7.0])
    assert layers.skin_thickness == Layers().skin_thickness
    assert read_layers(tmp_path, LayerTable(skin_thickness=0.25), 10.0, 3).skin_thickness == 2.5


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("1\n2\n", "has 2 numbers but the skin has 3 vertices; give one number a line"),
        ("1\ntwo\n3\n", "cannot be read as one number a line"),
        ("1\n-2\n3\n", "'fat_thickness' must be from 0 to 200 mm, not -2 (skin vertex 1)"),
    ],
)
def test_bad_thickness_files_are_refused(tmp_path: Path, text: str, rule: str) -> None:
    (tmp_path / "fat.txt").write_text(text, encoding="utf-8")
    with refuses(rule, begins=tmp_path):
        read_layers(tmp_path, LayerTable(fat_thickness="fat.txt"), 1.0, 3)


def test_a_case_with_layers_comes_back(tmp_path: Path) -> None:
    vertices = len(small_case().skin.vertices)
    thickness = np.random.default_rng(1).uniform(2.0, 9.0, vertices)
    (tmp_path / "labels.vtu").write_text("labels", encoding="utf-8")
    layers = Layers(
        skin_thickness=1.3,
        fat_thickness=thickness,
        constants={"skin": {"theta": 4.0}},
        mesh=tmp_path / "labels.vtu",
    )
    folder = tmp_path / "case"
    write_case(folder, replace(small_case(), layers=layers))
    again = there(read_case(folder).layers)
    assert again.skin_thickness == 1.3
    np.testing.assert_array_equal(again.fat_thickness, thickness)
    assert again.constants == layers.constants
    assert again.mesh == folder / "labels.vtu"
    assert (folder / "labels.vtu").read_text(encoding="utf-8") == "labels"
