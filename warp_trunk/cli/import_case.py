"""warp-trunk import"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from tyro.conf import Positional, UseAppendAction

from warp_trunk.case import check_case, write_case
from warp_trunk.case.case_writer import refuse_case
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import atomic_write
from warp_trunk.preparation.label_maps import Imported, ImportOptions, import_case, read_source
from warp_trunk.preparation.label_maps.mask import Mask
from warp_trunk.preparation.label_maps.sources import read_body, read_tissue
from warp_trunk.run.progress import Progress

from .inputs import cut_planes
from .output import INCOMPLETE, OK, next_command

PICTURE, CONFIDENCE = "landmarks_before.png", "landmarks_confidence.csv"


@dataclass(frozen=True, kw_only=True)
class Import:
    """Make a case from a label map of a CT or MRI, or from surfaces with other names.

    Ends with status 3 where something is missing without which no surgery can be planned: all that is there is
    written, and what is missing is named.
    """

    segmentation: Positional[Path]
    """A label map (.nii.gz, .nii, .seg.nrrd, .nrrd), or a folder with one mask for each class, or a folder of
    surfaces."""
    out: Path
    """Case folder to write."""
    body: Path | None = None
    """Mask of the body, from which the skin is made, if the segmentation has none (body.nii.gz)."""
    ct: Path | None = None
    """The CT, a file or a folder of DICOM files, from whose density the skin is made if there is no mask of the
    body."""
    tissue: Path | None = None
    """Masks of fat and muscle, from which the layers are measured, as TotalSegmentator -ta tissue_types writes
    them: a folder or a label map."""
    labels: str | None = None
    """Meaning of the numbers if the file does not state it: totalsegmentator-v2, totalsegmentator-v1, or a file
    .csv of numbers and names."""
    cut_above: float | None = None
    """Cut the neck flat at this height z [mm]; by default 25 mm above T1."""
    cut_below: float | None = None
    """Cut the thighs flat at this height z [mm]; by default 25 mm below the hip bones."""
    cut: UseAppendAction[tuple[str, ...]] = ()
    """Cut flat at planes, for example at the arms. x,y,z,nx,ny,nz,radius: a point, the normal towards the removed
    side, and the distance from the point to which the cut reaches [mm]."""
    options: Annotated[ImportOptions, tyro.conf.arg(name="")] = field(default_factory=ImportOptions)
    """How surfaces are made."""

    def run(self, arguments: Sequence[str]) -> int:
        """Writes the case folder, and says what is doubtful and what is missing."""
        refuse_case(self.out)
        if self.body is not None and self.ct is not None:
            raise InputError("--ct: the skin is made of --body, which is given too; leave one of them out")
        cuts = cut_planes(self.cut, self.cut_above, self.cut_below)
        with Progress() as progress:
            with progress.stage("load", f"reading {self.segmentation}"):
                source = read_source(self.segmentation, self.labels)
                body = self._body()
                tissue = None if self.tissue is None else read_tissue(self.tissue)
            made = import_case(
                source,
                body,
                self.out.resolve().name,
                self.options,
                tissue=tissue,
                cuts=tuple(cuts),
                stage=progress.stage,
            )
            with progress.stage("write", f"writing {self.out}"):
                self._write(made)
        _tell(made, source.left_over, source.empty)
        try:
            warnings = check_case(made.case)
        except InputError as error:
            print(
                f"warp-trunk: {self.out}: not yet a case that surgery can be planned on: {error}", file=sys.stderr
            )
            return INCOMPLETE
        for warning in warnings:
            print(f"warp-trunk: warning: {warning}", file=sys.stderr)
        print(f"Case '{made.case.name}' of {len(made.case.bones)} bones written to {self.out}")
        example = ("--uiv", "T4", "--liv", "L1", "--curve", "T8,correction=0.65")
        plan = next_command("plan", self.out, "--out", "planned", *example)
        print(f"Look at {self.out / PICTURE}, then plan: {plan}")
        return INCOMPLETE if made.found.unsure else OK

    def _body(self) -> Mask | None:
        if self.body is not None:
            return read_body(self.body)
        if self.ct is not None:
            from warp_trunk.preparation.label_maps.skin import body_in_scan

            return body_in_scan(self.ct)
        return None

    def _write(self, made: Imported) -> None:
        write_case(self.out, made.case)
        rows = ["vertebra,left_right_differ_mm,off_curve_deg,body_height_mm"]
        rows += [
            f"{name},{v.asymmetry:.2f},{v.off_curve:.1f},{v.height:.1f}"
            for name, v in made.found.vertebrae.items()
        ]
        with atomic_write(self.out / CONFIDENCE) as unfinished:
            unfinished.write_text("\n".join(rows) + "\n", encoding="utf-8")
        if made.found.vertebrae:
            from warp_trunk.report.landmark_picture import landmark_picture  # brings matplotlib

            picture = landmark_picture(made.case.bones, made.found, made.case.skin)
            with atomic_write(self.out / PICTURE) as unfinished:
                unfinished.write_bytes(picture)


def _tell(made: Imported, left_over: Sequence[str], empty: Sequence[str]) -> None:
    """Prints what was done to bones and where the body was cut; on stderr what is doubtful or not found."""
    changes = [abs(shape.change) for shape in made.shapes.values()]
    if changes:
        print(
            f"{len(changes)} bones drawn from voxels; smoothing changed no volume by more than "
            f"{100 * max(changes):.2f} %"
        )
    for plane in made.cuts:
        print(f"The body is cut flat at {plane}")
    if made.fat is not None:
        low, middle, high = np.percentile(made.fat, (5, 50, 95))
        print(
            f"Fat under the skin: {middle:.1f} mm in the median, {low:.1f} to {high:.1f} mm at nine of ten of "
            f"{len(made.fat)} points; simulate takes it for its layers"
        )
    if left_over:
        print(f"Not taken, as they are no bones of the trunk: {_some(left_over)}")
    if empty:
        print(f"Without a voxel: {_some(empty)}")
    for note in made.notes:
        print(f"warp-trunk: {note}", file=sys.stderr)
    for name, why in made.found.unsure.items():
        print(f"warp-trunk: {name}: no landmarks: {why}", file=sys.stderr)


def _some(names: Sequence[str], most: int = 12) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
