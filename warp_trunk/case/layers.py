"""Skin, fat and muscle: thickness and constants with their sources, and the table [layers] of case.toml."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np

from warp_trunk.checking import Array, check_fields
from warp_trunk.engine.tissue import TISSUE_LIMITS, Tissue
from warp_trunk.errors import InputError, closest_name
from warp_trunk.io.atomic_write import write_whole
from warp_trunk.io.file_access import MOST_SURFACE, FormatError, check_file, check_within, parsed_number, read_text
from warp_trunk.io.file_names import path_in

NAMES = ("skin", "fat", "muscle")
"""The layers from outside to inside; their numbers are the labels of tetrahedra. The last reaches to the bones
and stands for all that lies under the fat."""
CONSTANTS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "skin": MappingProxyType({"youngs_modulus": 130.0, "density": 1090.0}),
        "fat": MappingProxyType({"youngs_modulus": 2.5, "density": 950.0}),
        "muscle": MappingProxyType({"youngs_modulus": 10.0, "density": 1050.0}),
    }
)
"""Young's moduli at small strain [kPa] and densities [kg/m^3]; every other constant is that of the uniform tissue.

- Skin 130 kPa: 129 +- 88 on the forearm in vivo, by suction (Diridollou et al., Skin Res. Technol. 6(4), 2000,
  214-221); 56 +- 16 on the breast, likewise ("In vivo measurement of breast tissues stiffness using a light
  aspiration device", 2022). Reviews give 5 kPa to 140 MPa, by the test and the strain.
- Fat 2.5 kPa: 3.0 +- 1.2 under that skin of the breast; shear modulus 0.75 kPa of the buttock in vivo, by magnetic
  resonance, so 2.3 (Hatt, Lloyd, Bolsterlee and Bilston, J. Mech. Behav. Biomed. Mater. 2023, 105924,
  doi 10.1016/j.jmbbm.2023.105924).
- Muscle 10 kPa, between relaxed muscle across its fibres and the muscle of the back along them: shear modulus
  1.0 kPa of the buttock by magnetic resonance, so 3 (Hatt et al.), and 19 kPa of the multifidus lying prone by
  shear waves, so 56 (Sadeghi, Bible and Cortes 2020, doi 10.1115/1.4047651). It is that of the uniform tissue.
- Densities: ICRP Publication 110, Ann. ICRP 39(2), 2009, table B.1.
"""
SKIN_THICKNESS = 2.0
"""Thickness of epidermis and dermis [mm]: 2.54 over the scapula and 1.91 at the waist of adults, by ultrasound
(Laurent et al., Vaccine 25, 2007, doi 10.1016/j.vaccine.2007.05.046), 1.3 to 1.4 on the back of children of five
(Vaccine 29, 2011, doi 10.1016/j.vaccine.2011.07.111)."""
FAT_THICKNESS = 6.0
"""Thickness of the fat under the skin of the back [mm]: half of a subscapular skinfold, which is pinched double,
less the skin. Its median is 11.8 mm for girls of 12 and 19.0 mm for those of 17 (2114 adolescents, J. Korean
Pediatr. Soc. 39(6), 1996, 773-779), so 4 to 7.5 mm; 3 mm for boys of 17."""
THICKNESS = ("skin_thickness", "fat_thickness")
MOST_THICKNESS = 200.0
"""No layer is thicker than this [mm]; a larger number is in another unit."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Layers:
    """The layers of a case.

    >>> layered = dataclasses.replace(case, layers=wt.Layers(fat_thickness=8.0))
    >>> layered.layers.tissues(layered.tissue)[1].youngs_modulus
    2.5
    """

    skin_thickness: float | Annotated[np.ndarray, Array(None, finite=False)] = SKIN_THICKNESS
    """Thickness of the skin [mm], everywhere or at each skin vertex, shape (skin vertices,)."""
    fat_thickness: float | Annotated[np.ndarray, Array(None, finite=False)] = FAT_THICKNESS
    """Thickness of the fat under it [mm], likewise."""
    constants: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Constants of `Tissue` that the case gives, by name of layer and constant."""
    mesh: Path | None = None
    """A mesh (.vtu, mm, LPS) whose cells say in the cell data `tissue` which layer they are of."""

    def __post_init__(self) -> None:
        check_fields(self, "layers")
        for layer, constants in self.constants.items():
            if layer not in NAMES:
                raise InputError(
                    f"layers: there is no layer '{layer}'{closest_name(layer, NAMES)}; take {' or '.join(NAMES)}"
                )
            check_constants(constants, f"layers.{layer}")
        for name in THICKNESS:
            values = np.atleast_1d(getattr(self, name))
            good = np.isfinite(values) & (values >= 0.0) & (values <= MOST_THICKNESS)
            if not good.all():
                at = "" if values.size == 1 else f" (skin vertex {int(np.argmin(good))})"
                raise InputError(
                    f"layers: '{name}' must be from 0 to {MOST_THICKNESS:g} mm, not {values[~good][0]:g}{at}; "
                    "correct it, or the units of the case"
                )

    def tissues(self, uniform: Tissue) -> tuple[Tissue, ...]:
        """The tissue of each layer; what neither the case nor `CONSTANTS` gives is that of the uniform tissue."""
        return tuple(
            replace(uniform, **{**CONSTANTS[name], **self.constants.get(name, {})})  # its own checks speak
            for name in NAMES
        )

    def bottoms(self, vertices: int) -> np.ndarray:
        """Depth of the lower side of skin and fat under each skin vertex [mm], shape (2, vertices).

        Raises:
            InputError: a thickness that is given for another number of vertices.
        """
        for name in THICKNESS:
            values = np.atleast_1d(getattr(self, name))
            if values.size not in (1, vertices):
                counts = f"{values.size} numbers but the skin has {vertices} vertices"
                raise InputError(f"layers: '{name}' has {counts}; give one for each in order, or one for all")
        skin = np.broadcast_to(self.skin_thickness, vertices)
        return np.stack([skin, skin + self.fat_thickness])


def check_constants(constants: Mapping[str, float], table: str) -> None:
    """InputError for a key of a table of a file that is no constant of a tissue, or a value that none has."""
    for name in constants:
        if name not in TISSUE_LIMITS:
            hint = closest_name(name, TISSUE_LIMITS).replace("mean '", f"mean '{table}.")
            keys = ", ".join(f"{table}.{constant}" for constant in TISSUE_LIMITS)
            raise InputError(f"unknown key '{table}.{name}'{hint}; the keys are {keys}")
    try:
        Tissue(**constants)
    except InputError as error:
        raise InputError(f"{table}: {str(error).removeprefix('tissue: ')}") from None


@dataclass(frozen=True, kw_only=True)
class LayerConstants:
    """Constants by layer, as files give them: some of `Tissue`, by name."""

    skin: dict[str, float] = field(default_factory=dict)
    """Of the skin, from the table [layers.skin]."""
    fat: dict[str, float] = field(default_factory=dict)
    """Of the fat, likewise."""
    muscle: dict[str, float] = field(default_factory=dict)
    """Of the muscle, likewise."""

    def __post_init__(self) -> None:
        """Raises InputError for what is no constant of a tissue."""
        for name in NAMES:
            check_constants(getattr(self, name), f"layers.{name}")

    @property
    def constants(self) -> dict[str, dict[str, float]]:
        """Constants by name of layer, of the layers that have some."""
        return {name: constants for name in NAMES if (constants := getattr(self, name))}


@dataclass(frozen=True, kw_only=True)
class LayerTable(LayerConstants):
    """The table [layers]; every key may be omitted."""

    skin_thickness: float | str | None = None
    """In the unit of the case, or the name of a file with one number for each vertex of the skin."""
    fat_thickness: float | str | None = None
    """Likewise."""
    mesh: str | None = None
    """Name of a mesh with labels."""

    @property
    def entries(self) -> dict[str, Any]:
        """Values by key, as a file has them."""
        return {name: getattr(self, name) for name in (*THICKNESS, "mesh")} | self.constants


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
            check_within(folder, path_in(folder, value))
            value = read_numbers(path_in(folder, value), vertices)
        if value is not None:
            thickness[name] = millimetres * value
    mesh = None if table.mesh is None else path_in(folder, table.mesh)
    if mesh is not None:
        check_within(folder, mesh)
        check_file(mesh, "case.toml names it, layers.mesh; add it", MOST_SURFACE)
    try:
        return Layers(**thickness, constants=table.constants, mesh=mesh)
    except InputError as error:
        raise InputError(f"{folder / 'case.toml'}: {error}") from None


def write_layers(folder: Path, layers: Layers) -> LayerTable:
    """Writes the files of the layers into a case folder; the table names them. Lengths are in mm."""
    table: dict[str, Any] = {name: dict(constants) for name, constants in layers.constants.items()}
    for name in THICKNESS:
        table[name] = getattr(layers, name)
        if isinstance(table[name], np.ndarray):
            write_whole(
                folder / f"{name}.txt", "".join(f"{parsed_number!r}\n" for parsed_number in table[name].tolist())
            )
            table[name] = f"{name}.txt"
    if layers.mesh is not None:
        table["mesh"] = layers.mesh.name
        if layers.mesh.parent.resolve() != folder.resolve():
            write_whole(folder / layers.mesh.name, layers.mesh.read_bytes())
    return LayerTable(**table)


def read_numbers(path: Path, count: int) -> np.ndarray:
    """One number in each line of a text file, shape (count,); what follows a # is left out.

    Raises:
        InputError: a missing file, something else than a number in a line, or another count.
    """
    lines = read_text(path, "case.toml names it as one number a line").split("\n")
    texts = [text for line in lines if (text := line.split("#", 1)[0].strip())]
    try:
        values = np.array([parsed_number(text) for text in texts])
    except FormatError as error:
        raise InputError(f"{path}: cannot be read as one number a line ({error}); correct it") from error
    if values.shape != (count,):
        cure = "give one number a line for each vertex, in the order of the skin"
        raise InputError(f"{path}: has {len(values)} numbers but the skin has {count} vertices; {cure}")
    return values
