"""Content of a file or folder: masks and surfaces by our names, and the structures that were not recognised."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.image_files.image_reader import ENDINGS, Image, image_ending, image_stem, read_labels
from warp_trunk.io.surface_files import read_surface, surface_files

from .mask import Mask, boxes, joined
from .names import ARMS, FAT, MUSCLE, SKIN, TABLES, known_name, label_table

_JOINED = {"sacrum", SKIN}
"""Things that may be in several labels: the first sacral vertebra is one of its own in TotalSegmentator."""


@dataclass
class Source:
    """The structures that were found, by our names."""

    masks: dict[str, Mask] = field(default_factory=dict)
    surfaces: dict[str, Surface] = field(default_factory=dict)
    """As in their files: LPS and mm."""
    left_over: list[str] = field(default_factory=list)
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
            both = joined(self.masks[name], mask) if name in _JOINED else None
            if both is None:
                raise InputError(f"{where}: is '{name}', and so is another label; give each bone one label")
            mask = both
        self.masks[name] = mask


def read_source(path: Path, labels: str | None = None) -> Source:
    """Reads a label map, a folder of one mask for each class, or a folder of surfaces.

    Args:
        path: a file .nii, .nii.gz, .nrrd or .seg.nrrd, or a folder of such or of surface files.
        labels: which names the numbers of a label map stand for, see `label_table`; the file's own when left out.

    Raises:
        InputError: nothing that can be read, a damaged file, labels without names, or no bone among them.
    """
    table = None if labels is None else label_table(labels)
    found = _folder(path, table) if path.is_dir() else _label_map(path, table)
    if not found.names - {SKIN, ARMS, FAT, MUSCLE}:
        known = ", ".join(found.left_over[:5])
        raise InputError(
            f"{path}: none of its labels is a bone that is known"
            + (f" (it has {known}{', ...' if len(found.left_over) > 5 else ''})" if known else "")
            + "; a label is named as in TotalSegmentator, vertebrae_T8, or give --labels"
        )
    return found


def read_tissue(path: Path) -> dict[str, Mask]:
    """The fat under the skin and the muscles, as TotalSegmentator's task `tissue_types` writes them.

    Args:
        path: a label map with names, or a folder of masks.

    Returns:
        `subcutaneous_fat`, and `skeletal_muscle` where it is there.

    Raises:
        InputError: nothing that can be read, or no fat in it.
    """
    masks = (_folder(path, None) if path.is_dir() else _label_map(path, None)).masks
    if FAT not in masks:
        raise InputError(
            f"{path}: has no label or mask '{FAT}' with a voxel in it; give what TotalSegmentator -ta "
            "tissue_types writes"
        )
    return {name: masks[name] for name in (FAT, MUSCLE) if name in masks}


def read_body(path: Path) -> Mask:
    """The mask of the body in a file: what it calls so, or all that is not 0.

    Raises:
        InputError: a damaged file, or no voxel in it.
    """
    image = read_labels(path)
    names = {value: known_name(name) for value, name in image.names[0].items()}
    body = [value for value, name in names.items() if name == SKIN and (image.layers[0] == value).any()]
    mask = _mask_of(np.isin(image.layers[0], body) if body else (image.layers != 0).any(axis=0), image)
    if mask is None:
        raise InputError(
            f"{path}: has no voxel that is not 0, and the body was expected; give the mask of the body"
        )
    return mask


def _label_map(path: Path, table: Mapping[int, str] | None) -> Source:
    image = read_labels(path)
    names = image.names if table is None else tuple(table for _ in image.layers)
    if not any(names):
        raise InputError(
            f"{path}: its labels have no names, and their numbers mean other bones in other versions of a "
            f"program; give --labels {' or '.join(TABLES)}, or a file .csv of numbers and names"
        )
    found = Source(notes=[f"{path}: {note}." for note in image.notes])
    for layer, known in zip(image.layers, names, strict=True):
        _add_layer(found, layer, known, image, path)
    return found


def _add_layer(found: Source, layer: np.ndarray, names: Mapping[int, str], image: Image, path: Path) -> None:
    for value, box in boxes(layer).items():
        label = names.get(value, f"label {value}")
        name = known_name(label) if value in names else None
        if name is None:
            found.left_over.append(label)
            continue
        i, j, k = (part.start for part in box)
        mask = Mask(layer[box] == value, (i, j, k), image.affine, _shape(image))
        found.add(name, mask, f"{path}: label {value} ({label})")


def _folder(folder: Path, table: Mapping[int, str] | None) -> Source:
    if table is not None:
        raise InputError(
            f"{folder}: is a folder, where files have names and labels no numbers; leave --labels out"
        )
    found = Source()
    inner = folder / "bones"
    places = (folder, inner) if inner.is_dir() else (folder,)
    for name, path in _named(
        ((stem, file) for place in places for stem, file in surface_files(place).items()), found
    ):
        if name in found.surfaces:
            raise InputError(f"{path}: is '{name}', and so is another file; keep one of them")
        found.surfaces[name] = read_surface(path)
    images = sorted(path for path in folder.iterdir() if image_ending(path) and not path.name.startswith("."))
    for name, path in _named(((image_stem(path), path) for path in images), found):
        if name in found.surfaces:
            raise InputError(f"{path}: is '{name}', and so is a surface in this folder; keep one of them")
        image = read_labels(path)
        found.notes += [f"{path}: {note}." for note in image.notes]
        mask = _mask_of((image.layers != 0).any(axis=0), image)
        if mask is None:
            found.empty.append(name)
        else:
            found.add(name, mask, str(path))
    if not found.names and not found.left_over and not found.empty:
        raise InputError(
            f"{folder}: there is no mask ({', '.join(ENDINGS)}) and no surface in it; give the folder that the "
            "segmentation was written to, or one file with all labels"
        )
    return found


def _named(files: Iterable[tuple[str, Path]], found: Source) -> list[tuple[str, Path]]:
    """The files that are ours, by our names; the others are left over, and not even read."""
    ours = []
    for stem, path in files:
        name = known_name(stem)
        if name is None:
            found.left_over.append(stem)
        else:
            ours.append((name, path))
    return ours


def _mask_of(inside: np.ndarray, image: Image) -> Mask | None:
    """The box around what is inside; None where nothing is."""
    return Mask(inside, (0, 0, 0), image.affine, _shape(image)).part(inside)


def _shape(image: Image) -> tuple[int, int, int]:
    i, j, k = image.layers.shape[1:]
    return i, j, k
