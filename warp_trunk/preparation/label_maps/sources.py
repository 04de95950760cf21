"""Content of a file or folder: masks and surfaces by our names, and the structures that were not recognised.

Words are understood, not whole names, so that `vertebrae_T8` and `rib_left_1` of TotalSegmentator, "eighth
thoracic vertebra" and "left first rib" of BodyParts3D, "T8 vertebra" of 3D Slicer and `rib_left_01` of this
program are all known.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from warp_trunk.case.anatomy import SIDES, bone_of_words, words_of
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.file_access import read_text
from warp_trunk.io.image_files.dicom_seg import is_dicom
from warp_trunk.io.image_files.image import Image
from warp_trunk.io.image_files.image_reader import ENDINGS, image_ending, image_stem, read_labels
from warp_trunk.io.surface_files import read_surface, surface_files

from .mask import Mask, boxes, joined_masks

SKIN, ARMS, CARTILAGES = "skin", "extremities", "costal_cartilages"
FAT, MUSCLE = "subcutaneous_fat", "skeletal_muscle"
"""Structures that are no single bone: the body, all costal cartilages in one, tissue, arms and legs."""
_WHOLE = {
    **dict.fromkeys(("body", "body trunc", "body trunk", "trunk", "skin", "body trunc mask"), SKIN),
    "body extremities": ARMS,
    **dict.fromkeys(("costal cartilages", "costal cartilage"), CARTILAGES),
    **dict.fromkeys(("s 1", "vertebrae s 1", "vertebra s 1"), "sacrum"),  # TotalSegmentator labels it apart
    "skeletal muscle": MUSCLE,
}
_NO_BONE = {"implant", "prosthesis", "muscle", "artery", "vein", "vena", "nerve", "disc", "disk", "body", "bodies"}
"""Words that make something else of a bone's name; a vertebra's body is no vertebra."""


def known_name(text: str) -> str | None:
    """Our name for what a segmentation or a collection of surfaces calls `text`; None where it is none of ours.

    Bones are named as in a case (`T8`, `rib_left_01`, `hip_left`); what is no single bone by the constants of this
    module.
    """
    words = words_of(text)
    plain = " ".join(words)
    if plain in _WHOLE:
        return _WHOLE[plain]
    if words[-2:] == ["subcutaneous", "fat"] or words[:2] == ["subcutaneous", "adipose"]:
        return FAT
    return None if _NO_BONE & set(words) else bone_of_words(words)


_SPINE = [f"vertebrae_{region}{n}" for region, most in (("L", 5), ("T", 12), ("C", 7)) for n in range(most, 0, -1)]
_RIBS = [f"rib_{side}_{n}" for side in SIDES for n in range(1, 13)]
_PAIRS = [f"{bone}_{side}" for bone in ("humerus", "scapula", "clavicula", "femur", "hip") for side in SIDES]
TABLES: dict[str, dict[int, str]] = {
    "totalsegmentator-v1": dict([*enumerate(_SPINE, 18), *enumerate(_RIBS, 58), *enumerate(_PAIRS, 82)])
    | {92: "sacrum"},
    "totalsegmentator-v2": dict([*enumerate(_SPINE, 27), *enumerate(_PAIRS, 69), *enumerate(_RIBS, 92)])
    | {25: "sacrum", 26: "vertebrae_S1", 116: "sternum", 117: "costal_cartilages"},
}
"""Numbers of the bones in the task `total` of TotalSegmentator; between its versions they moved."""


_GIVE_TABLE = f"give --labels {' or '.join(TABLES)}, or a file .csv of numbers and names"


def label_table(source: str) -> dict[int, str]:
    """Names of labels by number.

    Args:
        source: a name of `TABLES`, or a CSV file of number and name, split by commas, semicolons or tabs.

    Raises:
        InputError: neither, or a line that is no number and name.
    """
    if source in TABLES:
        return TABLES[source]
    path = Path(source)
    if path.suffix.lower() != ".csv":
        raise InputError(
            f"--labels: must be {', '.join(TABLES)} or a file .csv of numbers and names, not '{source}'"
        )
    names: dict[int, str] = {}
    lines = read_text(path, "a table of labels (number,name) was expected").splitlines()
    for row, line in enumerate(lines, 1):
        number, name, *_ = (field.strip().strip('"') for field in (*re.split("[,;\t]", line), ""))
        if not line.strip() or line.startswith("#") or (row == 1 and not number.isdecimal()):
            continue  # the first line may name the columns
        if not number.isdecimal() or len(number) > 9 or not name:
            raise InputError(
                f"{path}: line {row} must be a number, a comma and a name, not '{line[:40]}'; correct it"
            )
        if int(number) in names:
            raise InputError(f"{path}: line {row} names label {number} again; give each number once")
        names[int(number)] = name
    if not names:
        raise InputError(f"{path}: names no label; give lines of a number, a comma and a name")
    return names


_JOINED = {"sacrum", SKIN}
"""Things that may be in several labels: the first sacral vertebra is one of its own in TotalSegmentator."""


@dataclass
class Source:
    """The structures that were found, by our names."""

    masks: dict[str, Mask] = field(default_factory=dict)
    surfaces: dict[str, Surface] = field(default_factory=dict)
    """As in their files: LPS and mm."""
    ignored: list[str] = field(default_factory=list)
    """Names that are none of ours."""
    empty: list[str] = field(default_factory=list)
    """Names of ours without a voxel, in masks of their own: TotalSegmentator writes one for all it can find."""
    notes: list[str] = field(default_factory=list)
    """A sentence for each doubt."""

    @property
    def names(self) -> set[str]:
        """Ours, of masks and surfaces."""
        return {*self.masks, *self.surfaces}

    def add(self, name: str, mask: Mask, where: str) -> None:
        """Puts in a mask; InputError where there is another of this name that it may not be joined with."""
        if name in self.masks:
            both = joined_masks(self.masks[name], mask) if name in _JOINED else None
            if both is None:
                raise InputError(f"{where}: is '{name}', and so is another label; give each bone one label")
            mask = both
        self.masks[name] = mask


def read_source(path: Path, labels: str | None = None) -> Source:
    """Reads a label map, a folder of one mask for each class, or a folder of surfaces.

    Args:
        path: a file .nii, .nii.gz, .nrrd or .seg.nrrd, a segmentation object of DICOM or its folder, or a folder
            of masks or of surface files.
        labels: which names the numbers of a label map stand for, see `label_table`; the file's own when left out.

    Raises:
        InputError: nothing that can be read, a damaged file, labels without names, or no bone among them.
    """
    table = None if labels is None else label_table(labels)
    source = _folder(path, table) if path.is_dir() else _label_map(path, table)
    if not source.names - {SKIN, ARMS, FAT, MUSCLE}:
        has = f" (it has {', '.join(source.ignored[:5])})" if source.ignored else ""
        cure = "name them as TotalSegmentator does, vertebrae_T8, or give --labels"
        raise InputError(f"{path}: none of its labels is a bone that is known{has}; {cure}")
    return source


def read_tissue(path: Path) -> dict[str, Mask]:
    """The fat under the skin and the muscles, as TotalSegmentator's task `tissue_types` writes them.

    Args:
        path: a label map with names, or a folder of masks.

    Returns:
        `subcutaneous_fat`, and `skeletal_muscle` where it is there.

    Raises:
        InputError: nothing that can be read, or no fat in it.
    """
    cure = "give the folder of masks that TotalSegmentator -ta tissue_types writes, or its label map with names"
    masks = (_folder(path, None) if path.is_dir() else _label_map(path, None, cure)).masks
    if FAT not in masks:
        raise InputError(f"{path}: has no label or mask '{FAT}' with a voxel in it; {cure}")
    return {name: masks[name] for name in (FAT, MUSCLE) if name in masks}


def read_body(path: Path) -> Mask:
    """The mask of the body in a file: what it calls so, or all that is not 0, with all that it encloses.

    Raises:
        InputError: a damaged file, or no voxel in it.
    """
    image = read_labels(path)
    body = [value for value, name in image.names[0].items() if known_name(name) == SKIN]
    inside = np.isin(image.layers[0], body)
    mask = _mask_of(inside if inside.any() else (image.layers != 0).any(axis=0), image)
    if mask is None:
        raise InputError(f"{path}: has no voxel that is not 0; give the mask of the body")
    return mask.filled()


def _label_map(path: Path, table: Mapping[int, str] | None, cure: str = _GIVE_TABLE) -> Source:
    image = read_labels(path)
    names = image.names if table is None else (table,) * len(image.layers)
    if not any(names):
        raise InputError(
            f"{path}: its labels have no names, and their numbers mean other bones in other versions of a "
            f"program; {cure}"
        )
    source = Source(notes=[f"{path}: {note}." for note in image.notes])
    for layer, names_of in zip(image.layers, names, strict=True):
        for value, box in boxes(layer).items():
            label = names_of.get(value, f"label {value}")
            texts = (label, *(() if table else image.meanings.get(value, ()))) if value in names_of else ()
            name = next((ours for text in texts if (ours := known_name(text))), None)
            if name is None:
                source.ignored.append(label)
                continue
            first = tuple(part.start for part in box)
            mask = Mask(layer[box] == value, first, image.affine, layer.shape)
            source.add(name, mask, f"{path}: label {value} ({label})")
    return source


def _folder(folder: Path, table: Mapping[int, str] | None) -> Source:
    if table is not None:
        raise InputError(f"{folder}: is a folder, whose files have names and no numbers; leave --labels out")
    source = Source()
    surfaces = [*surface_files(folder).items(), *surface_files(folder / "bones").items()]
    images = sorted(path for path in folder.iterdir() if image_ending(path) and not path.name.startswith("."))
    objects = [] if surfaces or images else [path for path in folder.iterdir() if is_dicom(path)]
    if len(objects) == 1:
        return _label_map(objects[0], None)
    if objects:
        raise InputError(
            f"{folder}: holds {len(objects)} DICOM objects, and one segmentation was expected; give its file, and "
            "the folder of the CT by --ct"
        )
    for stem, path in [*surfaces, *((image_stem(path), path) for path in images)]:
        name = known_name(stem)
        if name is None:
            source.ignored.append(stem)  # not even read
        elif name in source.surfaces:
            raise InputError(f"{path}: is '{name}', and so is a surface in this folder; keep one of them")
        elif not image_ending(path):
            source.surfaces[name] = read_surface(path)
        else:
            image = read_labels(path)
            source.notes += [f"{path}: {note}." for note in image.notes]
            mask = _mask_of((image.layers != 0).any(axis=0), image)
            if mask is None:
                source.empty.append(name)
            else:
                source.add(name, mask, str(path))
    if not source.names and not source.ignored and not source.empty:
        cure = "give the folder of the segmentation, or one file with all labels"
        raise InputError(f"{folder}: there is no mask ({', '.join(ENDINGS)}) and no surface in it; {cure}")
    return source


def _mask_of(inside: np.ndarray, image: Image) -> Mask | None:
    """The box around what is inside; None where nothing is."""
    return Mask(inside, (0, 0, 0), image.affine, inside.shape).part(inside)
