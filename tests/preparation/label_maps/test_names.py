"""Names of bones in other programs."""

import pytest

from warp_trunk.preparation.label_maps.sources import TABLES, known_name

KNOWN = {
    "vertebrae_T8": "T8",
    "vertebrae_S1": "sacrum",
    "rib_left_1": "rib_left_01",
    "costal_cartilages": "costal_cartilages",
    "clavicula_right": "clavicle_right",
    "body_trunc": "skin",
    "body_extremities": "extremities",
    "subcutaneous_fat": "subcutaneous_fat",
    "skeletal_muscle": "skeletal_muscle",
    "eighth thoracic vertebra": "T8",
    "left first rib": "rib_left_01",
    "Right 7th rib": "rib_right_07",
    "left third costal cartilage": "costal_cartilage_left_03",
    "T8 vertebra": "T8",
    "T8": "T8",
}
STRANGE = [
    "spleen", "vertebrae_body", "intervertebral_discs", "hip_implant", "iliac_artery_left", "rib", "fifth rib",
    "rib_left_14", "vertebrae_T14", "vertebrae_T0", "vertebrae", "gluteus_maximus_left", "hip", "left right hip",
    "kidney_cyst_left", "", "8", "T", "costal_cartilage_left_11", "torso_fat", "heart", "body of sternum", "FMA1",
]  # fmt: skip


@pytest.mark.parametrize(("theirs", "ours"), KNOWN.items())
def test_a_bone_is_known_by_the_names_of_others(theirs, ours):
    assert known_name(theirs) == ours


@pytest.mark.parametrize("name", STRANGE)
def test_what_is_none_of_ours_is_left_over(name):
    assert known_name(name) is None


def test_tables_of_both_versions_name_the_same_bones():
    ours = {version: {known_name(name) for name in table.values()} for version, table in TABLES.items()}
    assert None not in ours["totalsegmentator-v2"]
    assert ours["totalsegmentator-v2"] - ours["totalsegmentator-v1"] == {"sternum", "costal_cartilages"}
    assert ours["totalsegmentator-v1"] < ours["totalsegmentator-v2"]


def test_numbers_that_were_read_off_the_programs_themselves():
    new, old = TABLES["totalsegmentator-v2"], TABLES["totalsegmentator-v1"]
    assert [old[18], old[34], old[58], old[81], old[91]] == [
        "vertebrae_L5", "vertebrae_T1", "rib_left_1", "rib_right_12", "hip_right",
    ]  # fmt: skip
    assert [new[27], new[43], new[50], new[69], new[78], new[92], new[115]] == [
        "vertebrae_L5", "vertebrae_T1", "vertebrae_C1", "humerus_left", "hip_right", "rib_left_1", "rib_right_12",
    ]  # fmt: skip
