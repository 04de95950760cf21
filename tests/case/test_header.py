"""case.toml with its tables, the files that [layers] names, tissue.toml, and the error of landmarks."""

import tomllib
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from support.asserting import not_none
from support.shown import check_shown, described
from support.small_case import small_case
from warp_trunk.case import read_case, write_case
from warp_trunk.case.case import Study
from warp_trunk.case.header import CaseHeader, header_text, read_header
from warp_trunk.case.layers import Layers, LayerTable, read_layers
from warp_trunk.case.tissue_file import constant_of, read_tissue_file, with_constants, write_tissue_file
from warp_trunk.case.uncertainty import ON_BONES, Uncertainty, state_bone_landmarks
from warp_trunk.engine.tissue import Tissue


def read(folder: Path, text: str) -> CaseHeader:
    path = folder / "case.toml"
    path.write_text(text, encoding="utf-8")
    return read_header(path)


def test_an_empty_file_has_the_defaults_and_an_empty_table_those_of_layers(tmp_path: Path) -> None:
    assert read(tmp_path, "") == CaseHeader(name=tmp_path.name)
    assert read(tmp_path, "[layers]").layers == LayerTable()


STUDIES = [Study(patient='P "1"', pose="bending", months_after=0.1 + 0.2, synthetic=True), Study(synthetic=True)]


@pytest.mark.parametrize("study", [Study(), *STUDIES], ids=str)
@pytest.mark.parametrize("name", ["", 'quote " and \\ back', "tab\tnewline\nDEL\x7fbell\x07", "Ω 脊柱 🦴"])
def test_every_table_comes_back(tmp_path: Path, name: str, study: Study) -> None:
    header = CaseHeader(
        name=name,
        units="cm",
        axes="ASR",
        tissue=Tissue(epsilon=0.1 + 0.2, theta=1e-9, density=1e17, youngs_modulus=3),
        uncertainty=Uncertainty(cobb=0.1 + 0.2, theta=7),
        study=study,
        layers=LayerTable(skin_thickness=2.1, fat_thickness='fat "1".txt', mesh="a.vtu", fat={"theta": 0.3}),
    )
    assert read(tmp_path, header_text(header)) == header
    assert ("[study]" in header_text(header)) == (study != Study())


def test_thickness_is_in_the_unit_of_the_case_and_the_default_in_mm(tmp_path: Path) -> None:
    (tmp_path / "fat.txt").write_text("# over the back\n0.5\n0.6 # here\n0.7\n", encoding="utf-8")
    layers = read_layers(tmp_path, LayerTable(fat_thickness="fat.txt"), 10.0, 3)
    np.testing.assert_allclose(layers.fat_thickness, [5.0, 6.0, 7.0])
    assert layers.skin_thickness == Layers().skin_thickness
    assert read_layers(tmp_path, LayerTable(skin_thickness=0.25), 10.0, 3).skin_thickness == 2.5


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
    again = not_none(read_case(folder).layers)
    assert again.skin_thickness == 1.3
    np.testing.assert_array_equal(again.fat_thickness, thickness)
    assert again.constants == layers.constants
    assert again.mesh == folder / "labels.vtu"
    assert (folder / "labels.vtu").read_text(encoding="utf-8") == "labels"


CONSTANTS = {"poisson_ratio": 0.1 + 0.2, "fat.youngs_modulus": 3.25, "ribs.reversible_part": 0.55}


def test_what_is_set_is_there():
    case = with_constants(small_case(), CONSTANTS)
    assert {name: constant_of(case, name) for name in CONSTANTS} == CONSTANTS
    skin, fat, muscle = not_none(case.layers).tissues(case.tissue)
    assert (skin.youngs_modulus, fat.youngs_modulus, muscle.youngs_modulus) == (130.0, 3.25, 10.0)
    assert fat.poisson_ratio == 0.1 + 0.2
    assert case.tissue.theta == small_case().tissue.theta


def test_constants_of_the_ribs_make_no_layers_and_those_of_layers_stay():
    assert with_constants(small_case(), {"ribs.axial_rotation": 0.5, "epsilon": 2.0}).layers is None
    layers = Layers(constants={"fat": {"density": 900.0, "youngs_modulus": 1.0}})
    case = with_constants(replace(small_case(), layers=layers), {"fat.youngs_modulus": 2.0})
    assert not_none(case.layers).constants == {"fat": {"density": 900.0, "youngs_modulus": 2.0}}
    assert constant_of(small_case(), "fat.youngs_modulus") == 2.5  # the default of a layer


def test_tissue_comes_back(tmp_path):
    path = tmp_path / "tissue.toml"
    write_tissue_file(path, CONSTANTS, ["calibrated"])
    assert read_tissue_file(path) == CONSTANTS
    assert path.read_text(encoding="utf-8").startswith("# calibrated\n")


def test_defaults_of_a_case_are_as_accepted(tmp_path: Path) -> None:
    header = read(tmp_path, "[layers]\n[invented]\n")
    records = [header.tissue, header.uncertainty, header.study, header.ribs, header.invented, Layers()]
    lines = [
        f"{item.name} = {described(getattr(record, item.name))}" for record in records for item in fields(record)
    ]
    layers = Layers().tissues(header.tissue)
    check_shown("case_defaults", [f"posture = {header.posture}", *lines, *map(str, layers)])


def test_the_error_along_an_axis_is_a_third_of_the_mean_square_of_its_length() -> None:
    """Lengths of 3 and 5 mm, mean 4 and standard deviation 1, in any direction."""
    stated = Uncertainty(landmark_error=4.0, landmark_error_sd=1.0)
    assert 3.0 * stated.landmark_sd**2 == pytest.approx(np.mean(np.square([3.0, 5.0])))


def test_source_is_named_by_the_error_that_is_stated():
    assert "two films" in Uncertainty().landmark_source
    assert "bones" in Uncertainty(landmark_error=ON_BONES[0], landmark_error_sd=ON_BONES[1]).landmark_source
    assert Uncertainty(landmark_error=1.0).landmark_source == "as stated for this case"


@pytest.mark.parametrize(
    "text", ["", 'name = "anna"\n', 'name = "anna"\n[uncertainty]  # ours\ncobb = 3.0\n[tissue]\n']
)
def test_error_is_written_once_and_nothing_else_changes(tmp_path, text):
    path = tmp_path / "case.toml"
    path.write_text(text, encoding="utf-8")
    assert "0.5 ± 0.5 mm" in state_bone_landmarks(path)
    once = path.read_text(encoding="utf-8")
    table, before = tomllib.loads(once), tomllib.loads(text)
    stated = table.pop("uncertainty")
    assert (stated.pop("landmark_error"), stated.pop("landmark_error_sd")) == ON_BONES
    assert stated == before.pop("uncertainty", {})
    assert table == before
    assert "is kept" in state_bone_landmarks(path)
    assert path.read_text(encoding="utf-8") == once


@pytest.mark.parametrize("text", ["[uncertainty]\nlandmark_error = 2.1\n", "[invented]\nshare = 0.5\n"])
def test_a_stated_error_and_fitted_bones_are_left(tmp_path, text):
    path = tmp_path / "case.toml"
    path.write_text(text, encoding="utf-8")
    assert "is kept" in state_bone_landmarks(path)
    assert path.read_text(encoding="utf-8") == text
