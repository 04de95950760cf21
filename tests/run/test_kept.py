"""Meshes, compiled kernels, the patient that plans share and the live page's plans are made again where anything
changes on which they depend, and only there.

The things are the fields of the records; a new field fails until it is decided here.
"""

import shutil
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import warp_trunk.kernels

from support.changed_cases import CASE, CHANGES, EXECUTION, EXECUTION_WITHOUT, RUN, RUN_ELSEWHERE
from warp_trunk.bone_motion.plan import Plan, write_plan
from warp_trunk.case import Case, write_case
from warp_trunk.errors import InputError
from warp_trunk.live.saved_plans import SavedPlans
from warp_trunk.meshing import MeshOptions, build
from warp_trunk.run import patient, warming
from warp_trunk.run.options import Execution, RunOptions
from warp_trunk.run.patient import PreparedPatient, mesh_patient

MESHED = {"skin", "bones"}
"""Fields of a case on which its mesh depends."""
MODELLED = {*MESHED, "tissue", "layers"}
"""Those on which her model depends, too."""
MESH: dict[str, Any] = {
    "tets": 9000, "bone_margin": 3.0, "bone_voxel": 5.0, "bone_edge_length": 9.0, "bone_tolerance": 1.5,
    "radius_edge_ratio": 1.8,
}  # fmt: skip
"""Another value of each option of a mesh."""
COMPILED = {"energy", "weights", "skin_rigidity", "precision", "gravity", "alpha"}
"""Options by which kernels are chosen; `bones` has an energy and a skin of its own."""
PLAIN, ON_CPU = RunOptions(mesh=MeshOptions(tets=8000)), Execution(device="cpu", threads=1)


class AskedError(Exception):
    """The key of a mesh is known."""


@pytest.fixture
def keys(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The keys under which meshes are looked for; none is made."""
    keys: list[str] = []

    def asked(key: str) -> None:
        keys.append(key)
        raise AskedError

    monkeypatch.setattr(build, "load_cached", asked)
    return keys


def key_of(keys: list[str], case: Case, options: RunOptions = PLAIN) -> str:
    with pytest.raises(AskedError):
        mesh_patient(case, options, ON_CPU)
    return keys[-1]


def test_every_option_of_a_mesh_is_decided() -> None:
    assert {field.name for field in fields(MeshOptions)} == MESH.keys()


@pytest.mark.parametrize("option", MESH)
def test_another_option_of_the_mesh_makes_another_mesh(option: str, keys: list[str]) -> None:
    other = replace(PLAIN, mesh=replace(PLAIN.mesh, **{option: MESH[option]}))
    assert key_of(keys, CASE) == key_of(keys, CASE) != key_of(keys, CASE, other)


@pytest.mark.parametrize("field", CHANGES)
def test_the_mesh_depends_on_skin_and_bones_alone(
    field: str, keys: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(patient, "refuse_unread", lambda *_: None)  # constants that this energy does not read
    first = key_of(keys, CASE)
    for value in CHANGES[field]:
        assert (key_of(keys, replace(CASE, **{field: value})) != first) == (field in MESHED), value


def marker(options: RunOptions, execution: Execution = ON_CPU) -> Path:
    return warming._marker(warming._settings(options, execution))


def test_every_option_is_decided() -> None:
    assert RUN.keys() | RUN_ELSEWHERE.keys() == {field.name for field in fields(RunOptions)}
    assert EXECUTION.keys() | EXECUTION_WITHOUT == {field.name for field in fields(Execution)}


@pytest.mark.parametrize("option", RUN)
def test_kernels_are_compiled_ahead_for_the_options_by_which_they_are_chosen(option: str) -> None:
    plain = replace(PLAIN, energy="itmsm") if option == "alpha" else PLAIN  # another energy has none
    other = replace(plain, **{option: RUN[option]})
    changes = option in {*COMPILED, "bones"}
    assert (marker(plain) != marker(other)) == changes
    assert marker(other) == marker(replace(other))


def test_kernels_depend_on_where_they_run_and_not_on_what_is_kept() -> None:
    for option, value in EXECUTION.items():
        assert marker(PLAIN) != marker(PLAIN, replace(ON_CPU, **{option: value})), option
    for option in EXECUTION_WITHOUT:
        other = replace(ON_CPU, **{option: not getattr(ON_CPU, option)})
        assert marker(PLAIN) == marker(PLAIN, other), option


def test_kernels_are_compiled_again_where_their_text_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Path(warp_trunk.kernels.__path__[0])
    for file in folder.glob("*.py"):
        shutil.copy(file, tmp_path)
    first = marker(PLAIN)
    monkeypatch.setattr(warp_trunk.kernels, "__path__", [str(tmp_path)])
    assert marker(PLAIN) == first
    for file in sorted(tmp_path.glob("*.py")):
        text = file.read_bytes()
        file.write_bytes(text + b"# changed\n")
        assert marker(PLAIN) != first, file.name
        file.write_bytes(text)


@pytest.mark.parametrize("field", CHANGES)
def test_plans_share_a_patient_where_mesh_and_model_are_the_same(field: str) -> None:
    patient: Any = SimpleNamespace(case=CASE)
    for value in CHANGES[field]:
        other = replace(CASE, **{field: value})
        if field in MODELLED:
            with pytest.raises(
                InputError, match=r"must be of the same anatomy and tissue .*; simulate it on its own"
            ):
                PreparedPatient.check(patient, other)
        else:
            PreparedPatient.check(patient, other)


@pytest.mark.parametrize("field", CHANGES)
def test_the_live_page_takes_plans_of_the_same_landmarks_and_plans_them_anew(field: str, tmp_path: Path) -> None:
    """Their skins are not kept: each is relaxed in the tissue of the page that is open."""
    if field in {"points", "motions"}:
        pytest.skip("of a part of the body without a spine")
    for number, value in enumerate(CHANGES[field]):
        folder = tmp_path / str(number)
        case = replace(CASE, **{field: value})
        write_case(folder / "mine", case)
        write_plan(folder / "mine" / "plan.toml", Plan(uiv="T4", liv="L1"))
        saved = SavedPlans(folder, CASE)
        assert saved.names == (() if field == "landmarks_before" else ("mine",)), value
        assert saved.views == {}
