"""Constants by name, and tissue.toml."""

from dataclasses import replace

import pytest

from support.asserting import refuses, there
from support.small_case import small_case
from warp_trunk.case.layers import Layers
from warp_trunk.case.tissue_file import constant_of, read_tissue_file, with_constants, write_tissue_file

GIVEN = {"poisson_ratio": 0.1 + 0.2, "fat.youngs_modulus": 3.25, "ribs.reversible_part": 0.55}


def test_what_is_set_is_there():
    case = with_constants(small_case(), GIVEN)
    assert {name: constant_of(case, name) for name in GIVEN} == GIVEN
    skin, fat, muscle = there(case.layers).tissues(case.tissue)
    assert (skin.youngs_modulus, fat.youngs_modulus, muscle.youngs_modulus) == (130.0, 3.25, 10.0)
    assert fat.poisson_ratio == 0.1 + 0.2
    assert case.tissue.theta == small_case().tissue.theta


def test_constants_of_the_ribs_make_no_layers_and_those_of_layers_stay():
    assert with_constants(small_case(), {"ribs.axial_rotation": 0.5, "epsilon": 2.0}).layers is None
    layers = Layers(constants={"fat": {"density": 900.0, "youngs_modulus": 1.0}})
    case = with_constants(replace(small_case(), layers=layers), {"fat.youngs_modulus": 2.0})
    assert there(case.layers).constants == {"fat": {"density": 900.0, "youngs_modulus": 2.0}}
    assert constant_of(small_case(), "fat.youngs_modulus") == 2.5  # the default of a layer


def test_round_trip(tmp_path):
    path = tmp_path / "tissue.toml"
    write_tissue_file(path, GIVEN, ["calibrated"])
    assert read_tissue_file(path) == GIVEN
    assert path.read_text().startswith("# calibrated\n")
    path.write_text("[ribs]\nrecovery = 0.55\ndirect = 0.2\n")  # former names
    assert read_tissue_file(path) == {"ribs.reversible_part": 0.55, "ribs.derotation_transfer": 0.2}


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("[tisue]", "unknown key 'tisue' (did you mean 'tissue'?"),
        ("[tissue]\npoisson_ratio = 0.5", "'poisson_ratio' must be a number from 0 to 0.499"),
        ("[ribs]\nrecovery = '1'", "'ribs.reversible_part' must be a number, not '1'"),
        ("[ribs]\nturn = 0.5\naxial_rotation = 0.6", "unknown key 'ribs.turn'"),
    ],
)
def test_refused(tmp_path, text, rule):
    path = tmp_path / "tissue.toml"
    path.write_text(text)
    with refuses(rule, begins=path):
        read_tissue_file(path)
