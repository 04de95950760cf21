"""The table [layers] of case.toml, and the files it names."""

from __future__ import annotations

import dataclasses
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import atomic_write
from warp_trunk.io.file_access import check_within, number, read_text

from .keys import is_number, numbers, quoted, refuse_unknown, shown
from .layers import NAMES, Layers

THICKNESS = ("skin_thickness", "fat_thickness")
CONSTANT_NAMES = [constant.name for constant in dataclasses.fields(Tissue)]


@dataclass(frozen=True)
class LayerTable:
    """What [layers] says; every key may be left out."""

    skin_thickness: float | str | None = None
    """In the unit of the case, or the name of a file with one number for each vertex of the skin."""
    fat_thickness: float | str | None = None
    """Likewise."""
    mesh: str | None = None
    """Name of a mesh with labels."""
    constants: dict[str, dict[str, float]] = field(default_factory=dict)
    """What the tables [layers.skin], [layers.fat] and [layers.muscle] give of `Tissue`."""


def layer_table(path: Path, table: dict[str, Any]) -> LayerTable:
    """Checks the table [layers] of the file `path`.

    Raises:
        InputError: an unknown key, or a value of the wrong type or not allowed.
    """
    refuse_unknown(path, table, [*THICKNESS, "mesh", *NAMES], "layers.")
    for key in THICKNESS:
        if not (is_number(table.get(key, 0.0)) or isinstance(table[key], str)):
            raise InputError(
                f"{path}: 'layers.{key}' must be a number or the name of a file, not {shown(table[key])}; "
                "correct it"
            )
    if not isinstance(table.get("mesh", ""), str):
        raise InputError(
            f"{path}: 'layers.mesh' must be the name of a file, not {shown(table['mesh'])}; correct it"
        )
    constants: dict[str, dict[str, float]] = {}
    for name in NAMES:
        if not isinstance(table.get(name, {}), dict):
            raise InputError(f"{path}: 'layers.{name}' must be a table, [layers.{name}], not {shown(table[name])}")
        if name in table:
            constants[name] = numbers(path, table[name], CONSTANT_NAMES, f"layers.{name}.")
            Tissue(**constants[name])  # checks the values
    skin, fat = (
        float(table[key]) if is_number(table.get(key)) else table.get(key)  # 2 and 2.0 are the same thickness
        for key in THICKNESS
    )
    return LayerTable(skin, fat, table.get("mesh"), constants)


def layer_text(table: LayerTable) -> str:
    """The text of [layers], which `layer_table` reads back."""
    lines = ["", "[layers]"]
    for key in (*THICKNESS, "mesh"):
        value = getattr(table, key)
        if value is not None:
            lines.append(f"{key} = {quoted(value) if isinstance(value, str) else repr(value)}")
    for name, constants in table.constants.items():
        lines += ["", f"[layers.{name}]", *(f"{key} = {value!r}" for key, value in constants.items())]
    return "\n".join(lines) + "\n"


def read_layers(folder: Path, table: LayerTable, millimetres: float, vertices: int) -> Layers:
    """The layers that a table describes, with the files it names.

    Args:
        folder: the case folder.
        table: what its case.toml says.
        millimetres: the length unit of the case [mm].
        vertices: number of vertices of its skin.

    Raises:
        InputError: a file that is missing or has not one number for each vertex, or a thickness out of range.
    """
    thickness: dict[str, Any] = {}
    for name in THICKNESS:
        value = getattr(table, name)
        if isinstance(value, str):
            check_within(folder, folder / value)
            value = read_numbers(folder / value, vertices)
        if value is not None:
            thickness[name] = millimetres * value
    mesh = None if table.mesh is None else folder / table.mesh
    if mesh is not None:
        check_within(folder, mesh)
    if mesh is not None and not mesh.is_file():
        raise InputError(f"{mesh}: there is no such file, but case.toml names it, layers.mesh; add it")
    try:
        return Layers(**thickness, constants=table.constants, mesh=mesh)
    except InputError as error:
        raise InputError(f"{folder / 'case.toml'}: {error}") from None


def write_layers(folder: Path, layers: Layers) -> LayerTable:
    """Writes the files of the layers into a case folder; the table names them. Lengths are in mm."""
    thickness: dict[str, Any] = {}
    for name in THICKNESS:
        thickness[name] = getattr(layers, name)
        if isinstance(thickness[name], np.ndarray):
            lines = "".join(f"{number!r}\n" for number in thickness[name].tolist())
            thickness[name] = f"{name}.txt"
            with atomic_write(folder / thickness[name]) as unfinished:
                unfinished.write_text(lines, encoding="utf-8")
    if layers.mesh is not None and layers.mesh.parent.resolve() != folder.resolve():
        with atomic_write(folder / layers.mesh.name) as unfinished:
            shutil.copy(layers.mesh, unfinished)
    constants = {name: dict(given) for name, given in layers.constants.items()}
    return LayerTable(mesh=None if layers.mesh is None else layers.mesh.name, constants=constants, **thickness)


def read_numbers(path: Path, count: int) -> np.ndarray:
    """One number in each line of a text file, shape (count,); what follows a # is left out.

    Raises:
        InputError: a missing file, something else than a number in a line, or another count.
    """
    lines = read_text(path, "case.toml names it as one number a line").split("\n")
    texts = [text for line in lines if (text := line.split("#", 1)[0].strip())]
    try:
        values = np.array([number(text) for text in texts])
    except ValueError as error:
        raise InputError(f"{path}: cannot be read as one number a line ({str(error)[:80]}); correct it") from error
    if values.shape != (count,):
        raise InputError(
            f"{path}: has {len(values)} numbers but the skin has {count} vertices; "
            "give one number a line for each vertex, in the order of the skin"
        )
    return values
