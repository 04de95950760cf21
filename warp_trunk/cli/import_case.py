"""warp-trunk import"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from tyro.conf import Positional, UseAppendAction

from warp_trunk.case import check_case, write_case
from warp_trunk.case.folders import refuse_case
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import write_whole
from warp_trunk.io.file_names import name_of
from warp_trunk.preparation.label_maps import Imported, ImportOptions, import_case, read_source
from warp_trunk.preparation.label_maps.sources import read_body, read_tissue
from warp_trunk.run.progress import Progress

from .output import INCOMPLETE, OK, cut_planes, next_command

PICTURE, CONFIDENCE = "landmarks_before.png", "landmarks_confidence.csv"
MOST_NAMES = 12
"""Number of names of a list that are printed."""


@dataclass(frozen=True, kw_only=True)
class Import:
    """Make a case from a label map of a CT or MRI, or from surfaces with other names.

    Ends with status 3 where something is missing without which no surgery can be planned: all that is there is
    written, and what is missing is named.
    """

    segmentation: Positional[Path]
    """A label map (.nii.gz, .nii, .seg.nrrd, .nrrd), a DICOM segmentation object (.dcm), or a folder with one mask
    for each class, or a folder of surfaces."""
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

    def run(self) -> int:
        """Writes the case folder, and prints what is doubtful and what is missing."""
        refuse_case(self.out)
        if self.body is not None and self.ct is not None:
            raise InputError("--ct: the skin is made of --body, which is given too; leave one of them out")
        cuts = tuple(cut_planes(self.cut, self.cut_above, self.cut_below))
        with Progress() as progress:
            with progress.stage("load", f"reading {self.segmentation}"):
                source = read_source(self.segmentation, self.labels)
                body = None if self.body is None else read_body(self.body)
                if self.ct is not None:
                    from warp_trunk.preparation.label_maps.skin import body_in_scan

                    body = body_in_scan(self.ct)
                tissue = None if self.tissue is None else read_tissue(self.tissue)
            name, stage = name_of(self.out.resolve()), progress.stage
            made = import_case(source, body, name, self.options, tissue=tissue, cuts=cuts, stage=stage)
            with progress.stage("write", f"writing {self.out}"):
                write_case(self.out, made.case)
                _write_landmarks(self.out, made)
        said, doubts = _report(made, source.ignored, source.empty)
        print("\n".join(said))
        ends = _example(made.case.landmarks_before.vertebrae())
        example = ("--uiv", ends[0], "--liv", ends[2], "--curve", f"{ends[1]},correction=0.65")
        plan = next_command("plan", self.out, "--out", "planned", *example)
        try:
            more = [warning for warning in check_case(made.case) if warning not in made.notes]
            doubts += [f"warning: {warning}" for warning in more]
            print(f"Case '{made.case.name}' of {len(made.case.bones)} bones written to {self.out}")
            print(f"Look at {self.out / PICTURE}, then plan: {plan}")
            status = INCOMPLETE if made.landmarks.unsure else OK
        except InputError as error:
            doubts.append(f"{self.out}: not yet a case that surgery can be planned on: {error}")
            status = INCOMPLETE
        for doubt in doubts:
            print(f"warp-trunk: {doubt}", file=sys.stderr)
        return status


def _example(levels: Sequence[str]) -> tuple[str, str, str]:
    """Upper end, apex and lower end of a plan: T4, T8 and L1, or of the levels that there are."""
    usual = "T4", "T8", "L1"
    if len(levels) < 3 or set(usual) <= set(levels):
        return usual
    return levels[0], levels[len(levels) // 2], levels[-1]


def _write_landmarks(folder: Path, made: Imported) -> None:
    """Writes how sure each vertebra is, and a picture of the landmarks."""
    vertebrae = made.landmarks.vertebrae
    rows = [f"{name},{v.asymmetry:.2f},{v.off_curve:.1f},{v.height:.1f}\n" for name, v in vertebrae.items()]
    head = "vertebra,left_right_differ_mm,off_curve_deg,body_height_mm\n"
    write_whole(folder / CONFIDENCE, head + "".join(rows))
    if vertebrae:
        from warp_trunk.report.landmark_picture import landmark_picture  # brings matplotlib

        write_whole(folder / PICTURE, landmark_picture(made.case.bones, made.landmarks, made.case.skin))


def _report(made: Imported, ignored: Sequence[str], empty: Sequence[str]) -> tuple[list[str], list[str]]:
    """Lines on what was made, and lines on what is doubtful or was not found."""
    said = []
    if made.shapes:
        most = 100.0 * max(abs(shape.change) for shape in made.shapes.values())
        drawn = f"{len(made.shapes)} bones drawn from voxels"
        said.append(f"{drawn}; smoothing changed no volume by more than {most:.2f} %")
    said += [f"The body is cut flat at {plane}" for plane in made.cuts]
    if made.fat is not None:
        low, middle, high = np.percentile(made.fat, (5, 50, 95))
        said.append(
            f"Fat under the skin: {middle:.1f} mm in the median, {low:.1f} to {high:.1f} mm at nine of ten of "
            f"{len(made.fat)} points; simulate takes it for its layers"
        )
    for what, names in (("Not taken, as they are no bones of the trunk", ignored), ("Without a voxel", empty)):
        if names:
            more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
            said.append(f"{what}: {', '.join(names[:MOST_NAMES])}{more}")
    return said, [*made.notes, *(f"{name}: no landmarks: {why}" for name, why in made.landmarks.unsure.items())]
