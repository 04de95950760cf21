"""Commands that work on the surfaces of skin and bones: warp-trunk close, landmarks, make-case and cut."""

import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional, UseAppendAction

from warp_trunk.case import write_case
from warp_trunk.case.axes import MILLIMETRES, check_bones
from warp_trunk.case.folders import HEADER, is_case, refuse_case
from warp_trunk.case.header import read_header
from warp_trunk.case.landmarks import Landmarks, write_landmarks
from warp_trunk.case.uncertainty import state_bone_landmarks
from warp_trunk.errors import InputError
from warp_trunk.geometry.cutting import CutPlane, cut_bone
from warp_trunk.geometry.surface_checks import enclosed_volume
from warp_trunk.io.atomic_write import write_whole
from warp_trunk.io.file_access import check_place
from warp_trunk.io.file_names import check_file_names
from warp_trunk.io.surface_files import (
    check_written,
    in_lps,
    read_stated,
    read_surface,
    surface_files,
    write_surface,
)
from warp_trunk.io.transform_file import read_transform
from warp_trunk.preparation.deformity import MeasuredSpine, SpineCurve, make_case, read_measured_spine
from warp_trunk.preparation.deformity.published_curves import KYPHOSIS
from warp_trunk.preparation.landmark_finder import find_landmarks
from warp_trunk.preparation.scanning.closing import CloseOptions, close_skin
from warp_trunk.preparation.scanning.parts import align_parts, check_parts, moved
from warp_trunk.run.progress import Progress

from .output import INCOMPLETE, OK, cut_planes, next_command, read_bones


@dataclass(frozen=True, kw_only=True)
class Close:
    """Make one closed skin of a scan with holes, or of scans that overlap."""

    parts: Positional[tuple[Path, ...]]
    """Surfaces of the skin, oriented outward, in mm and LPS axes."""
    out: Path
    """File for the closed skin: .ply, .stl, .obj, .off or .glb."""
    transforms: tuple[Path, ...] = ()
    """A text file for each part, in order, with the 16 numbers of the rigid 4x4 matrix into the common frame."""
    refine: bool = False
    """Align the parts to the first one where they overlap, by some millimetres."""
    cut_above: float | None = None
    """Cut the neck flat at this height z [mm]."""
    cut_below: float | None = None
    """Cut the thighs flat at this height z [mm]."""
    cut: UseAppendAction[tuple[str, ...]] = ()
    """Cut flat at planes, for example at the arms. x,y,z,nx,ny,nz,radius: a point, the normal towards the removed
    side, and the distance from the point to which the cut reaches [mm]."""
    options: Annotated[CloseOptions, tyro.conf.arg(name="")] = field(default_factory=CloseOptions)
    """How the surface is made."""

    def run(self) -> int:
        """Writes the closed skin."""
        cuts = cut_planes(self.cut, self.cut_above, self.cut_below)
        check_written(self.out)
        if self.transforms and len(self.transforms) != len(self.parts):
            counts = f"{len(self.transforms)} files for {len(self.parts)} parts"
            raise InputError(f"--transforms: {counts}; give one for each")
        with Progress() as progress:
            with progress.stage("load", "reading the scans"):
                stated = {str(path): read_stated(path) for path in self.parts}
                parts = {name: in_lps(part, space) for name, (part, space) in stated.items()}
                if len(parts) < len(self.parts):
                    raise InputError("parts: a file is given twice; give each once")
                for name, path in zip(parts, self.transforms, strict=False):
                    parts[name] = moved(parts[name], read_transform(path))
                check_parts(parts)
            if self.refine:
                with progress.stage("align", "moving the parts onto each other"):
                    parts, alignments = align_parts(parts)
                for name, by in alignments.items():
                    print(
                        f"{name}: moved by {by.shift:.2f} mm and {by.turn:.2f} degrees, "
                        f"now {by.distance:.2f} mm from the others"
                    )
            with progress.stage("close", "closing the skin"):
                closed = close_skin(parts, cuts, self.options)
            is_stated = any(space is not None for _, space in stated.values())
            write_surface(self.out, closed.surface, "LPS" if is_stated else None)
        for opening in closed.openings:
            what, place = "end, flat" if opening.is_end else "hole", "({:.0f}, {:.0f}, {:.0f}) mm"
            print(f"Closed: {what}, {opening.area / 100.0:.1f} cm2 at {place.format(*opening.centre)}")
        print(f"Closed skin of {len(closed.surface.faces)} triangles written to {self.out}")
        return OK


@dataclass(frozen=True, kw_only=True)
class FindLandmarks:
    """Find the landmarks of a spine, curved or not, on the surfaces of its bones.

    Ends with status 3 if some were not found: they are named with the reason, the others are written.
    """

    bones: Positional[Path]
    """Folder with one surface for each bone, named after it (T7.ply, hip_left.ply), in mm and LPS axes; or a
    folder that contains a folder bones, in the units and axes of case.toml where it is a case."""
    out: Path
    """CSV file to write (name,x,y,z): six landmarks of each vertebra T1 to L5, and the iliac spines; in
    mm and LPS, or in the case's units and axes if it lies in the case folder."""
    picture: Path | None = None
    """PNG file to write: the bones from behind and from the left with the landmarks, for a visual check."""

    def run(self) -> int:
        """Writes the landmarks and names what is missing."""
        for place, ending in ((self.out, ".csv"), (self.picture, ".png")):
            if place is not None:
                if place.suffix.lower() != ending:
                    raise InputError(f"{place}: is written as {ending[1:].upper()}; end the name in {ending}")
                check_place(place)
        inner = self.bones / "bones"
        folder = inner if inner.is_dir() else self.bones
        with Progress() as progress:
            with progress.stage("load", f"reading the bones of {self.bones}"):
                case = folder.parent if folder.name == "bones" else self.bones
                header = read_header(case / HEADER)
                bones = read_bones(folder, lambda path: header.surface(path)[0])
                axes, size = header.frame, MILLIMETRES[header.units]
                check_bones(bones, str(self.bones), axes.code)
            with progress.stage("find", "finding landmarks"):
                landmarks = find_landmarks(bones)
            in_case = self.out.resolve().parent == case.resolve()
            points = landmarks.landmarks.points @ axes.matrix / size if in_case else landmarks.landmarks.points
            write_landmarks(self.out, Landmarks(landmarks.landmarks.names, points))
            if self.picture is not None:
                from warp_trunk.report.landmark_picture import landmark_picture  # brings matplotlib

                with progress.stage("picture", f"drawing {self.picture}"):
                    write_whole(self.picture, landmark_picture(bones, landmarks))
        print("vertebra   left and right differ by   off the curve by   body's height")
        for name, v in landmarks.vertebrae.items():
            print(f"{name:8}{v.asymmetry:22.2f} mm   {v.off_curve:12.1f} deg   {v.height:10.1f} mm")
        for name, why in landmarks.unsure.items():
            print(f"warp-trunk: {name}: not found: {why}", file=sys.stderr)
        print(f"{len(landmarks.landmarks.names)} landmarks written to {self.out}")
        if in_case and is_case(case):
            print(state_bone_landmarks(case / HEADER))
        return INCOMPLETE if landmarks.unsure else OK


@dataclass(frozen=True, kw_only=True)
class MakeCase:
    """Make a case from straight anatomy: impose a scoliosis and plan its correction."""

    skin: Path
    """The straight trunk, a closed surface in mm and LPS axes."""
    bones: Path
    """Folder with one surface for each bone, named after it: T7.ply, rib_left_01.ply, hip_left.ply."""
    out: Path
    """Case folder to write."""
    curve: Literal["thoracic", "thoracolumbar", "double_major"] = "thoracic"
    """Where the curve is."""
    cobb: float = 60.0
    """Cobb angle [degrees]."""
    rotation: float | None = None
    """Axial rotation of the apical vertebra [degrees]; from Cobb angle and kyphosis as in patients when left
    out."""
    kyphosis: float = KYPHOSIS[0]
    """Kyphosis from T5 to T12 [degrees]; 24 ± 14 in patients."""
    lumbar_rotation: float | None = None
    """Opposite axial rotation at the apex of the secondary curve [degrees]; 0.25 of its Cobb angle when left
    out."""
    spine: Path | None = None
    """Impose this measured spine in place of a published curve: a table name,x,y,z of body centre and pedicles of
    each level (T4_body, T4_left_pedicle, T4_right_pedicle), or landmarks of a case, in mm and LPS."""
    direction: Literal["right", "left"] = "right"
    """The side to which the curve is convex; of a double major, its thoracic curve."""
    correction: float = 0.7
    """Fraction of Cobb angle and axial rotation that surgery takes away, 0 to 1."""

    def run(self) -> int:
        """Writes the case folder."""
        if not 0.0 <= self.correction <= 1.0:
            percent = f"for {self.correction:g} % write {self.correction / 100.0:g}"
            cure = percent if 1.0 < self.correction <= 100.0 else "give a fraction, such as 0.7"
            raise InputError(f"--correction: must be a number from 0 to 1, not {self.correction:g}; {cure}")
        if self.spine is not None:
            curve = read_measured_spine(self.spine)
        else:
            curve = SpineCurve(
                kind=self.curve,
                cobb=self.cobb,
                apical_rotation=self.rotation,
                direction=self.direction,
                kyphosis=self.kyphosis if self.cobb > 0.0 else None,
                secondary_rotation=self.lumbar_rotation,
            )
        refuse_case(self.out)
        with Progress() as progress:
            with progress.stage("load", f"reading the skin and the bones of {self.bones}"):
                bones, skin = read_bones(self.bones), read_surface(self.skin)
            with progress.stage("make", f"imposing {curve}"):
                case = make_case(skin, bones, curve, self.correction)
            with progress.stage("write", f"writing {self.out}"):
                write_case(self.out, case)
        if isinstance(curve, MeasuredSpine) and curve.continued:
            print(f"{self.spine} has no {curve.continued[0]} to {curve.continued[-1]}: the curve fades out there")
        print(f"Case '{case.name}' written to {self.out}")
        print(f"Simulate it: {next_command('simulate', self.out)}")
        return OK


@dataclass(frozen=True, kw_only=True)
class Cut:
    """Cut a bone of a case at a plane into closed parts, which can then move separately."""

    case: Positional[Path]
    """Case folder. The whole bone is kept in its folder bones_uncut, which no command reads."""
    bone: str
    """Name of the bone."""
    plane: tuple[float, float, float, float, float, float]
    """A point of the plane and its normal, x y z nx ny nz, in mm and in the axes of the case."""
    names: tuple[str, ...]
    """Names of the parts: the one that the normal points away from, then those beyond the plane, from larger
    to smaller x."""
    radius: float = math.inf
    """Cut only parts beyond the plane that come nearer to its point than this [mm]; by default all. A bone that is
    cut again stays whole in bones_uncut."""

    def run(self) -> int:
        """Writes the parts in place of the bone."""
        header = read_header(self.case / HEADER)
        files = surface_files(self.case / "bones")
        if self.bone not in files:
            raise InputError(f"--bone: there is no '{self.bone}' in {self.case / 'bones'}; give one that is there")
        check_file_names([*(name for name in files if name != self.bone), *self.names], "--names")
        for name in self.names:
            if name in files and name != self.bone:
                raise InputError(f"--names: '{name}' is another bone; give another name")
        size, file = MILLIMETRES[header.units], files[self.bone]
        x, y, z, a, b, c = self.plane
        plane = CutPlane((x / size, y / size, z / size), (a, b, c), self.radius / size)
        surface, space = read_stated(file, size)
        if header.axes == "LPS" and space is not None:  # the header holds, and the plane is in LPS
            surface, space = in_lps(surface, space), "LPS"
        parts = cut_bone(surface, plane, str(file))
        if len(parts) != len(self.names) or len(set(self.names)) < len(self.names):
            raise InputError(f"--names: {len(parts)} parts need as many different names, not {len(self.names)}")
        whole = self.case / "bones_uncut" / file.name
        whole.parent.mkdir(exist_ok=True)
        if whole.exists():
            file.unlink()  # a part that an earlier cut left
        else:
            file.rename(whole)
        for name, part in zip(self.names, parts, strict=True):
            write_surface(file.with_name(f"{name}.ply"), part, space)
            print(f"{name}: {enclosed_volume(part) * size**3 / 1000.0:.2f} cm3")
        print(f"Written to {file.parent}; the whole bone is {whole}")
        return OK
