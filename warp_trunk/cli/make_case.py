"""warp-trunk make-case"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from warp_trunk.case import write_case
from warp_trunk.case.case_writer import refuse_case
from warp_trunk.io.surface_files import read_surface
from warp_trunk.preparation.deformity import MeasuredSpine, SpineCurve, make_case, read_measured_spine
from warp_trunk.preparation.deformity.published_curves import KYPHOSIS
from warp_trunk.run.progress import Progress

from .inputs import read_bones
from .output import OK, next_command


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
    each level (T4_body, T4_left_pedicle, T4_right_pedicle) in mm and LPS."""
    direction: Literal["right", "left"] = "right"
    """The side to which the curve is convex; of a double major, its thoracic curve."""
    correction: float = 0.7
    """Fraction of Cobb angle and axial rotation that surgery takes away, 0 to 1."""

    def run(self, arguments: Sequence[str]) -> int:
        """Writes the case folder."""
        curve = read_measured_spine(self.spine) if self.spine is not None else self._published()
        refuse_case(self.out)
        with Progress() as progress:
            with progress.stage("load", f"reading the skin and the bones of {self.bones}"):
                bones = read_bones(self.bones)
                skin = read_surface(self.skin)
            with progress.stage("make", f"imposing {curve}"):
                case = make_case(skin, bones, curve, self.correction)
            with progress.stage("write", f"writing {self.out}"):
                write_case(self.out, case)
        if isinstance(curve, MeasuredSpine) and curve.continued:
            print(f"{self.spine} has no {curve.continued[0]} to {curve.continued[-1]}: the curve fades out there")
        print(f"Case '{case.name}' written to {self.out}")
        print(f"Simulate it: {next_command('simulate', self.out)}")
        return OK

    def _published(self) -> SpineCurve:
        return SpineCurve(
            kind=self.curve,
            cobb=self.cobb,
            apical_rotation=self.rotation,
            direction=self.direction,
            kyphosis=self.kyphosis if self.cobb > 0.0 else None,
            secondary_rotation=self.lumbar_rotation,
        )
