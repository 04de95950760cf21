"""The result of a simulation: in memory, written to a folder, and read back without the case it came from."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from functools import partial as bound
from pathlib import Path
from typing import Any

import numpy as np

from warp_trunk.bone_motion.plan import Plan, plan_in
from warp_trunk.case.folders import refuse_case
from warp_trunk.case.landmarks import NO_LANDMARKS, Landmarks, read_landmarks, write_landmarks
from warp_trunk.case.motions import Motion, motions_text, read_motions
from warp_trunk.checking import checked
from warp_trunk.engine.relaxation import RelaxStatus
from warp_trunk.engine.trunk_mesh import TrunkMesh
from warp_trunk.errors import InputError, MissingFileError
from warp_trunk.geometry.surface import Surface, short_digest
from warp_trunk.io.atomic_write import complete, named, partial, replace
from warp_trunk.io.file_access import read_text
from warp_trunk.io.folders import locked, make_writable
from warp_trunk.io.result_files import (
    ACTUAL_SKIN,
    EFFECTS,
    LANDMARKS_AFTER,
    LANDMARKS_BEFORE,
    MEASURES,
    MOST_PLAN,
    MOTIONS,
    PAGE,
    PICTURES,
    PLAN,
    PREDICTED_SKIN,
    RECORDING,
    SECTIONS,
    SKIN_BEFORE,
    SKIN_SD,
    SUMMARY,
    TRUNK,
    UNSEEN_SKIN,
    picture_source,
)
from warp_trunk.io.surface_files import read_surface, write_surface
from warp_trunk.io.trunk_file import read_trunk, write_trunk
from warp_trunk.measures import TrunkMeasures
from warp_trunk.measures.quantities import ACTUAL, BEFORE, BETTER, PREDICTED, WORSE, Measured, MeasureTable

from .bands import Effects, read_effects, read_skin_sd, write_effects, write_skin_sd
from .sections import read_sections, write_sections
from .summary import Summary, read_summary, write_summary

LEAST_SPACE = 200e6
"""Free space that a result folder needs [bytes]; the largest results seen take a third of it."""
SIMULATE_AGAIN = "simulate the case again"


@dataclass(eq=False, kw_only=True, repr=False)
class Result:
    """The trunk predicted by a simulation, with everything that its report needs.

    `simulate` returns one, and `read_result` reads one from its folder; `write_report` makes its page, and
    `view_result` opens its recording. A notebook shows it as a picture of the back before surgery and as
    predicted.

    >>> result.converged  # of wt.simulate(case)
    True
    >>> bool(abs(result.measures.max_thoracic_bsr) < abs(result.measures_before.max_thoracic_bsr))
    True
    >>> result.save(folder / "demo").folder.name
    'demo'
    """

    skin_before: Surface
    """The skin before surgery [mm]."""
    skin: Surface
    """The predicted skin [mm], same vertices and faces."""
    actual_skin: Surface | None
    """The actual skin after surgery [mm], with triangles of its own; None where it is not known."""
    landmarks_before: Landmarks
    """Points on the bones before surgery [mm]."""
    landmarks_after: Landmarks
    """The same points after surgery [mm], same names in the same order."""
    summary: Summary
    """How the simulation ended, its options and its numbers: the contents of summary.json."""
    states: dict[str, TrunkMeasures]
    """Where each state was measured, by its name: before, predicted, and actual where that skin is known; a likely
    better and worse one, at the level of the main hump, with bands."""
    read_tissue: Callable[[], tuple[TrunkMesh, np.ndarray]]
    """Gives `tissue`, which is large."""
    unseen: np.ndarray | None = None
    """1 for each vertex of the skin that was not measured, else 0, shape (vertices,); None where all were."""
    skin_sd: np.ndarray | None = None
    """Standard deviation of the place of each vertex of the predicted skin along its normal [mm], shape
    (vertices,); None without bands."""
    effects: Effects | None = None
    """Effects of the errors on its numbers; None without bands."""
    plan_text: str | None = None
    """The plan.toml that made it; None where no plan did."""
    motions: Mapping[str, Motion] = field(default_factory=dict)
    """The motions of bones that made it, by their names, in LPS and mm; none where a plan did."""
    saved_in: Path | None = None
    """Its result folder; None before `save`."""
    recording: Path | None = None
    """Rerun's recording of the simulation; None where none was made."""

    def __repr__(self) -> str:
        return f"Result({self.summary.case!r}, {self.status.name})"

    @property
    def folder(self) -> Path:
        """Its result folder.

        Raises:
            InputError: it is not saved yet.
        """
        if self.saved_in is None:
            raise InputError("result: is not saved yet; call result.save(folder) first")
        return self.saved_in

    @property
    def status(self) -> RelaxStatus:
        """Why the last relaxation ended."""
        return self.summary.status

    @property
    def converged(self) -> bool:
        """Whether every node is within the tolerance of its equilibrium."""
        return self.status is RelaxStatus.CONVERGED

    @property
    def plan(self) -> Plan | None:
        """The plan that made it; None where none did."""
        return plan_in(self.plan_text)

    @property
    def bands(self) -> tuple[Measured, ...]:
        """The predicted numbers with 95 % intervals, `low` to `high`; none unless asked for (`bands=True`).

        Sources of the intervals are in `summary.bands`.
        """
        return tuple(row for row in self.table.rows if row.state == PREDICTED and row.low is not None)

    @property
    def fingerprint(self) -> str:
        """A short name of exactly this plan and prediction, for a sheet that is signed: it changes with the plan
        or the motions, the landmarks before and after, and the predicted skin."""
        marks, skins = (self.landmarks_before, self.landmarks_after), (self.skin_before, self.skin)
        points = [np.round(points_of.points, 3) for points_of in marks]  # as their files have them
        points += [np.round(skin.vertices, 3).astype(np.float32) for skin in skins]
        return short_digest(self.plan_text or "", *([self.motions_text] if self.motions else []), *points)

    @property
    def motions_text(self) -> str:
        """The text of its motions.toml."""
        return motions_text(self.motions)

    @cached_property
    def table(self) -> MeasureTable:
        """Every measured number, by state, quantity and level."""
        return MeasureTable(self.summary.measures)

    def to_rows(self) -> list[dict[str, Any]]:
        """Every measured number as a row of state, level, quantity, value, low and high, as summary.json has it.

        >>> rows = result.to_rows()
        >>> [row["level"] for row in rows if row["state"] == "before" and row["quantity"] == "cobb_deg"]
        ['T1-T5', 'T5-T12', 'T12-L5']

        Returns:
            A dictionary for each number. A unit ends the name of the quantity; `low` and `high` are None without
            bands.
        """
        return self.table.to_rows()

    def to_columns(self) -> dict[str, np.ndarray]:
        """The same numbers as a typed array for each column, which pandas and polars read as they are.

        >>> columns = result.to_columns()  # pandas.DataFrame(columns) or polars.DataFrame(columns)
        >>> columns["low"].dtype.name
        'float64'

        Returns:
            By column, shape (rows,) each; NaN where a number is not known.
        """
        return self.table.to_columns()

    @property
    def measures(self) -> TrunkMeasures:
        """The measures of the predicted skin."""
        return self.states[PREDICTED]

    @property
    def measures_before(self) -> TrunkMeasures:
        """The measures of the skin before surgery."""
        return self.states[BEFORE]

    @cached_property
    def tissue(self) -> tuple[TrunkMesh, np.ndarray]:
        """The mesh before surgery, and the displacement of its nodes [mm], shape (nodes, 3)."""
        return self.read_tissue()

    @checked
    def save(self, folder: str | Path) -> Result:
        """Write the result folder, with everything of the case that its report needs.

        It holds `skin_before.ply` and `predicted_skin.ply` (the same vertices and faces), `actual_skin.ply` where
        the case has one, `landmarks_before.csv`, `landmarks_after.csv`, `sections.npz`, `trunk.vtu`,
        `summary.json`, the recording, `skin_sd.csv` and `effects.npz` where there are bands, and the
        `plan.toml` or `motions.toml` that made the case.

        Every file is written under another name and moved when all are complete, summary.json last: a folder that
        has a summary is complete. What an earlier simulation left in the same folder is removed, also the report
        and the measures, which would describe another prediction.

        Returns:
            The result itself, with its `folder`.

        Raises:
            InputError: the folder cannot be written to, is or lies in a case folder, or another process writes
                into it.
        """
        # absolute, so that it stays where it is if the process changes its folder
        folder = prepare_folder(Path(folder).absolute())
        if self.saved_in is None or self.saved_in.resolve() != folder.resolve():
            with locked(folder):
                write_result(folder, self)
        return self


def prepare_folder(folder: str | Path) -> Path:
    """Create a result folder and make sure, before any long work, that a result can be written to it.

    Raises:
        InputError: it is a case folder or lies in one, cannot be created or written to, or too little space is
            free.
    """
    folder = Path(folder)
    refuse_case(folder)
    if any("\ud800" <= letter <= "\udfff" for letter in str(folder.absolute())):
        raise InputError(f"{folder}: is no path in UTF-8, which the viewer's file needs; give --out another name")
    make_writable(folder, "a result")
    free = shutil.disk_usage(folder).free
    if free < LEAST_SPACE:
        space = f"{free / 1e6:.0f} MB are free on this disk"
        raise InputError(f"{folder}: {space}; a result needs {LEAST_SPACE / 1e6:.0f} MB")
    return folder


def write_result(folder: Path, result: Result) -> None:
    """Write a result into a folder that is prepared and kept from other processes; see `Result.save`."""
    before, after = result.landmarks_before, result.landmarks_after
    contents: dict[str, tuple[Callable[..., object], object]] = {
        SKIN_BEFORE: (write_surface, result.skin_before),
        PREDICTED_SKIN: (write_surface, result.skin),
        ACTUAL_SKIN: (write_surface, result.actual_skin),
        LANDMARKS_BEFORE: (write_landmarks, before if before.names else None),
        LANDMARKS_AFTER: (write_landmarks, after if after.names else None),
        PLAN: (_write_text, result.plan_text),
        MOTIONS: (_write_text, result.motions_text if result.motions else None),
        SKIN_SD: (write_skin_sd, result.skin_sd),
        UNSEEN_SKIN: (write_skin_sd, result.unseen),
        EFFECTS: (write_effects, result.effects),
        SECTIONS: (write_sections, result.states),
        SUMMARY: (write_summary, result.summary),
    }
    written = {name: content for name, content in contents.items() if content[1] is not None}
    recording, partial_file = result.recording, partial(folder / RECORDING)
    with named(folder):
        write_trunk(partial(folder / TRUNK), *result.tissue)
        for name, (write, content) in written.items():
            write(partial(folder / name), content)
        if recording is not None and recording != partial_file:
            shutil.copyfile(recording, partial_file)
    made_of_it = [PAGE, *(f"{MEASURES}.{ending}" for ending in ("json", "csv", "png"))]
    for name in (SUMMARY, *contents, RECORDING, *made_of_it):  # first what says that it is complete
        (folder / name).unlink(missing_ok=True)
    for picture in (folder / PICTURES).glob("*.png"):
        with picture.open("rb") as file:
            ours = picture_source(picture.stem).encode() in file.read(1000)
        if ours:  # others are the user's
            picture.unlink()
    if recording is not None:
        replace(partial_file, folder / RECORDING)
    for name in (TRUNK, *written):
        complete(folder / name)
    result.saved_in, result.recording = folder, None if recording is None else folder / RECORDING


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")


@checked
def read_result(folder: str | Path) -> Result:
    """Read and check a result folder.

    >>> _ = result.save(folder / "read")
    >>> wt.read_result(folder / "read").summary == result.summary
    True

    Raises:
        InputError: it is no result folder, a file is missing or damaged, or files do not belong together.
    """
    folder = Path(folder)
    summary = read_summary(folder)

    def present(name: str) -> Path:
        if not (folder / name).is_file():
            raise MissingFileError(f"{folder / name}: is missing, though {SUMMARY} is there; {SIMULATE_AGAIN}")
        return folder / name

    before, after = (read_surface(present(name)) for name in (SKIN_BEFORE, PREDICTED_SKIN))
    if not np.array_equal(before.faces, after.faces) or before.vertices.shape != after.vertices.shape:
        other = f"its vertices or faces are not those of {SKIN_BEFORE}"
        raise InputError(f"{folder / PREDICTED_SKIN}: {other}; {SIMULATE_AGAIN}")
    planned = reached = NO_LANDMARKS
    if summary.has_spine or (folder / LANDMARKS_BEFORE).exists():
        planned, reached = (read_landmarks(present(name)) for name in (LANDMARKS_BEFORE, LANDMARKS_AFTER))
    if planned.names != reached.names:
        rule = f"its names must be those of {LANDMARKS_BEFORE}, in their order"
        raise InputError(f"{folder / LANDMARKS_AFTER}: {rule}; {SIMULATE_AGAIN}")
    plan, motions, recording = folder / PLAN, folder / MOTIONS, folder / RECORDING
    return Result(
        skin_before=before,
        skin=after,
        actual_skin=read_surface(present(ACTUAL_SKIN)) if summary.has_actual else None,
        landmarks_before=planned,
        landmarks_after=reached,
        summary=summary,
        states=read_sections(
            present(SECTIONS), {BEFORE: planned} | dict.fromkeys((PREDICTED, ACTUAL, BETTER, WORSE), reached)
        ),
        read_tissue=bound(read_trunk, folder / TRUNK),
        unseen=None if summary.invented is None else read_skin_sd(folder / UNSEEN_SKIN, len(after.vertices)),
        skin_sd=None if summary.bands is None else read_skin_sd(folder / SKIN_SD, len(after.vertices)),
        effects=None if summary.bands is None else read_effects(folder / EFFECTS, len(after.vertices)),
        plan_text=read_text(plan, "the plan of a result", MOST_PLAN) if plan.is_file() else None,
        motions=read_motions(motions) if motions.is_file() else {},
        saved_in=folder,
        recording=recording if recording.is_file() else None,
    )
