"""warp-trunk landmarks"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from warp_trunk.case.landmarks import write_landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.atomic_write import atomic_write
from warp_trunk.io.file_access import check_place
from warp_trunk.preparation.landmark_finder import FoundLandmarks, find_landmarks
from warp_trunk.run.progress import Progress

from .inputs import read_bones
from .output import INCOMPLETE, OK


@dataclass(frozen=True, kw_only=True)
class FindLandmarks:
    """Find the landmarks of a spine, curved or not, on the surfaces of its bones.

    Ends with status 3 if some were not found: they are named with the reason, the others are written.
    """

    bones: Positional[Path]
    """Folder with one surface for each bone, named after it (T7.ply, hip_left.ply), in mm and LPS axes; or a
    folder, such as a case, that contains a folder bones."""
    out: Path
    """CSV file to write (name,x,y,z): six landmarks of each vertebra T1 to L5, and the iliac spines."""
    picture: Path | None = None
    """PNG file to write: the bones from behind and from the left with the landmarks, for a visual check."""

    def run(self, arguments: Sequence[str]) -> int:
        """Writes the landmarks and names what is missing."""
        if self.out.suffix.lower() != ".csv":
            raise InputError(f"{self.out}: landmarks are written as CSV; end the name in .csv")
        check_place(self.out)
        if self.picture is not None:
            if self.picture.suffix.lower() != ".png":
                raise InputError(f"{self.picture}: the picture is written as PNG; end the name in .png")
            check_place(self.picture)
        inner = self.bones / "bones"
        with Progress() as progress:
            with progress.stage("load", f"reading the bones of {self.bones}"):
                bones = read_bones(inner if inner.is_dir() else self.bones)
            with progress.stage("find", "finding landmarks"):
                found = find_landmarks(bones)
            with atomic_write(self.out) as unfinished:
                write_landmarks(unfinished, found.landmarks)
            if self.picture is not None:
                with progress.stage("picture", f"drawing {self.picture}"):
                    _draw(self.picture, bones, found)
        _tell(found)
        print(f"{len(found.landmarks.names)} landmarks written to {self.out}")
        return INCOMPLETE if found.unsure else OK


def _draw(place: Path, bones: Mapping[str, Surface], found: FoundLandmarks) -> None:
    from warp_trunk.report.landmark_picture import landmark_picture  # brings matplotlib

    picture = landmark_picture(bones, found)
    with atomic_write(place) as unfinished:
        unfinished.write_bytes(picture)


def _tell(found: FoundLandmarks) -> None:
    """Prints what speaks for each vertebra, and on stderr what was not found."""
    print("vertebra   left and right differ by   off the curve by   body's height")
    for name, vertebra in found.vertebrae.items():
        off = f"{vertebra.asymmetry:22.2f} mm   {vertebra.off_curve:12.1f} deg   {vertebra.height:10.1f} mm"
        print(f"{name:8}{off}")
    for name, why in found.unsure.items():
        print(f"warp-trunk: {name}: not found: {why}", file=sys.stderr)
