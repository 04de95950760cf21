"""From masks and surfaces with our names to a case with landmarks."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import numpy as np
from msgspec import Meta

from warp_trunk.case import Case
from warp_trunk.case.anatomy import VERTEBRAE, of_trunk, rib_of
from warp_trunk.case.anatomy_checks import anatomy_doubts
from warp_trunk.case.axes import misplaced
from warp_trunk.case.case import Posture
from warp_trunk.case.landmarks import ASIS, NO_LANDMARKS
from warp_trunk.case.layers import Layers
from warp_trunk.case.uncertainty import ON_BONES, Uncertainty
from warp_trunk.checking import check_fields
from warp_trunk.errors import InputError
from warp_trunk.geometry.coarsening import without_slivers
from warp_trunk.geometry.core_threads import each_over_cores
from warp_trunk.geometry.cutting import CutPlane
from warp_trunk.geometry.surface import Surface
from warp_trunk.geometry.surface_checks import slivers

from ..landmark_finder import FoundLandmarks, find_landmarks
from .cartilages import split_cartilages
from .fat import fat_thickness, reached
from .mask import Mask
from .segmentation_checks import (
    doubts_of_bones,
    doubts_of_extents,
    doubts_of_image,
    other_numbers,
    wrong_way_round,
)
from .skin import body_skin, check_cuts
from .sources import CARTILAGES, FAT, MUSCLE, SKIN, Source
from .surfaces import LEAST_VOXELS, BoneShape, bone_shape

_AT_ARMS = ("humerus", "scapula")
"""Bones that say where the arms begin, by how their names begin."""
_COVERED = 0.95
"""Masks of fat that reach less of the skin are named."""
_EDGE_LENGTHS = (1.0, 0.96, 1.04)
"""Where a skin keeps a triangle that is too thin, it is drawn again with edges of another length."""
Stage = Callable[[str, str], AbstractContextManager[object]]
"""Shows that a stage has begun, by its name and a sentence."""


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """How a label map becomes a case."""

    smoothing: Annotated[float, Meta(ge=0.0, le=5.0, description="mm")] = 0.8
    """How much the stairs of voxels on bones are smoothed: standard deviation of a Gaussian [mm]."""
    edge_length: Annotated[float, Meta(ge=2.0, le=20.0, description="mm")] = 7.0
    """Length of the edges of the skin [mm]."""
    more_bones: bool = False
    """Take shoulder blades, collar bones and costal cartilages too; without them soft tissue fills their place."""
    posture: Posture = "supine"
    """How the patient was scanned: supine, prone or standing."""

    def __post_init__(self) -> None:
        """Raises InputError for a number out of range or a posture that is not known."""
        check_fields(self, "import")


@dataclass(frozen=True, eq=False)
class Imported:
    """A case as far as the image reaches, and what was done to get it."""

    case: Case
    """Without landmarks of bones on which they were not found."""
    landmarks: FoundLandmarks
    """The landmarks, what speaks for them, and what was not found."""
    shapes: Mapping[str, BoneShape]
    """Of the bones that came from voxels."""
    cuts: tuple[CutPlane, ...]
    """Where the body was cut flat."""
    fat: np.ndarray | None
    """The thickness of fat at the vertices of the skin where it was measured [mm]; None without masks of it."""
    notes: tuple[str, ...]
    """A sentence for each thing that a user should look at."""


def import_case(
    source: Source,
    body: Mask | None,
    name: str,
    options: ImportOptions | None = None,
    *,
    tissue: Mapping[str, Mask] | None = None,
    cuts: tuple[CutPlane, ...] = (),
    stage: Stage = lambda _name, _doing: nullcontext(),
) -> Imported:
    """Make a case of what was found in an image.

    Args:
        source: masks and surfaces, see `read_source`.
        body: the body; that of the source when left out.
        name: what to call the case.
        options: how; the defaults when left out.
        tissue: the fat under the skin and the muscles, see `read_tissue`; those of the source when left out.
        cuts: where to cut the body flat, besides neck and thighs.
        stage: shows the stages.

    Raises:
        InputError: there is no body, no vertebra, or nothing that a surface comes of.
    """
    options = options or ImportOptions()
    if body is None and SKIN in source.masks:
        body = source.masks[SKIN].filled()
    if body is not None:
        check_cuts(body, cuts)
    elif SKIN not in source.surfaces:
        cure = "give --body FILE (TotalSegmentator -ta body makes one) or --ct FILE"
        raise InputError(f"import: there is no body among the labels, and a trunk needs its skin; {cure}")
    masks, notes = source.masks, list(source.notes)
    if options.more_bones and CARTILAGES in masks:
        with stage("cartilages", "separating costal cartilages"):
            masks, more = _with_cartilages(masks)
            notes += more
    of_case = partial(of_trunk, girdle=options.more_bones)
    wanted = {n for n in (*masks, *source.surfaces) if of_case(n) or n.startswith(_AT_ARMS)}
    few = {n: count for n in masks if n in wanted and (count := np.count_nonzero(masks[n].inside)) < LEAST_VOXELS}
    notes += [
        f"{n}: left out, as it has {count} voxels, and {LEAST_VOXELS} are needed; look at this label."
        for n, count in few.items()
    ]
    labels = sorted(n for n in masks if n in wanted and n not in few)
    trunk = [n for n in (*labels, *source.surfaces) if of_trunk(n)]
    if not trunk:
        has = ", ".join(sorted({*masks, *source.surfaces, *source.ignored} - {SKIN})[:5])
        raise InputError(f"import: there is no bone of the trunk among the labels ({has}); a case needs vertebrae")
    with stage("bones", f"drawing the surfaces of {len(labels)} bones"):
        drawn = each_over_cores(lambda n: bone_shape(masks[n], n, options.smoothing), labels)
        shapes = dict(zip(labels, drawn, strict=True))
    surfaces = {n: s for n, s in source.surfaces.items() if n in wanted}
    surfaces |= {n: shape.surface for n, shape in shapes.items()}
    with stage("skin", "drawing the skin"):
        if body is None:
            skin, made = without_slivers(source.surfaces[SKIN]), ()
        else:
            skin, made = _drawn_skin(body, surfaces, cuts, options.edge_length)
    bones = {n: s for n, s in surfaces.items() if of_case(n)}
    own = {n: masks[n] for n in bones if n in masks}
    cut = {n for n, mask in own.items() if mask.faces_at_border()}
    turned = other_numbers(bones) or (wrong_way_round(bones) if {1, 2} & misplaced(bones).keys() else [])
    with stage("landmarks", "finding landmarks"):
        landmarks = FoundLandmarks(NO_LANDMARKS, {}, {}) if turned else _landmarks(bones, cut)
    tissue = tissue or masks
    layers, fat = None, None
    if FAT in tissue:
        with stage("fat", "measuring the fat under the skin"):
            thickness, measured = fat_thickness(skin, tissue[FAT], tissue.get(MUSCLE), made)
        layers, fat = Layers(fat_thickness=thickness), thickness[measured]
        covered = reached(skin.vertices, [tissue[n] for n in (FAT, MUSCLE) if n in tissue]).mean()
        if covered < _COVERED:
            notes.append(
                f"Fat: the masks of fat and muscle reach {100.0 * covered:.0f} % of the skin; the rest is "
                "not measured there, and the median stands for it."
            )
    case = Case(
        name=name,
        skin=skin,
        bones=bones,
        landmarks_before=landmarks.landmarks,
        posture=options.posture,
        uncertainty=Uncertainty(landmark_error=ON_BONES[0], landmark_error_sd=ON_BONES[1]),
        layers=layers,
    )
    spine = {n: bones[n] for n in VERTEBRAE if n in bones}
    extents = {"the body": body} | {f"the mask of {n}": tissue[n] for n in (FAT, MUSCLE) if n in tissue}
    notes += doubts_of_extents({n: mask for n, mask in extents.items() if mask}, own)
    doubts = turned or (*doubts_of_bones(bones, cut), *doubts_of_image(own, body, spine))
    notes += [*doubts, *(() if turned else anatomy_doubts(case))]
    case = replace(case, notes=tuple(notes))
    return Imported(case, landmarks, shapes, made, fat, (*notes, *_dropped(shapes, bones)))


def _drawn_skin(
    body: Mask, bones: Mapping[str, Surface], cuts: tuple[CutPlane, ...], edge_length: float
) -> tuple[Surface, tuple[CutPlane, ...]]:
    """The skin without slivers, and where it was cut; of the lengths of edges that are tried the first without."""
    drawn = []
    for factor in _EDGE_LENGTHS:
        skin, made = body_skin(body, bones, cuts, factor * edge_length)
        drawn.append((without_slivers(skin), made))
        if not len(slivers(drawn[-1][0])):
            return drawn[-1]
    return drawn[0]


def _with_cartilages(masks: Mapping[str, Mask]) -> tuple[dict[str, Mask], list[str]]:
    """The masks with all cartilages separated, and sentences about the separation."""
    separate = {name: mask for name, mask in masks.items() if name != CARTILAGES}
    if "sternum" not in separate:
        return separate, [f"{CARTILAGES}: left out, as the sternum that they lead to has no label."]
    ribs = {name: mask for name, mask in separate.items() if rib_of(name)}
    split, lost = split_cartilages(masks[CARTILAGES], ribs, separate["sternum"])
    note = f"{CARTILAGES}: {lost / 1000.0:.1f} cm3 of it hang together with no rib, and were left out."
    return {**separate, **split}, [note] if lost > 0.0 else []


def _landmarks(bones: Mapping[str, Surface], cut: Container[str]) -> FoundLandmarks:
    """Landmarks of whole bones; a vertebra that the image cuts off has none."""
    whole = {name: bone for name, bone in bones.items() if name not in VERTEBRAE or name not in cut}
    if any(name in whole for name in VERTEBRAE):
        landmarks = find_landmarks(whole)
    else:
        landmarks = FoundLandmarks(NO_LANDMARKS, {}, dict.fromkeys(ASIS, "there is no spine"))
    parts = {name: "the image ends in it, so that only a part is there" for name in bones if name in cut}
    reasons = {**landmarks.unsure, **parts}
    return replace(landmarks, unsure={name: reasons[name] for name in (*VERTEBRAE, *ASIS) if name in reasons})


def _dropped(shapes: Mapping[str, BoneShape], bones: Container[str]) -> list[str]:
    """Which bones of a case are not in one piece."""
    notes = []
    for name, shape in shapes.items():
        if name in bones and shape.dropped:
            lost = sum(shape.dropped)
            share = 100.0 * lost / (shape.volume + lost)
            what = f"{name}: {len(shape.dropped)} pieces that do not hang together with the largest were left out"
            notes.append(f"{what}, {lost / 1000.0:.2f} cm3 ({share:.1f} %).")
    return notes
