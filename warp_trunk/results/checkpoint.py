"""The increments done so far, on disk, from which a simulation that was stopped goes on."""

from __future__ import annotations

import json
import logging
import shutil
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from warp_trunk.engine.relaxation import Relaxation
from warp_trunk.engine.simulation import Increment
from warp_trunk.errors import InputError
from warp_trunk.io.atomic_write import complete, partial

from .fingerprint import Fingerprint, difference

if TYPE_CHECKING:
    from warp_trunk.engine.model import Model

CHECKPOINT = "checkpoint"
FORMAT = 3
"""Raised whenever a file would be read another way."""
WORTH_WAITING = 1.0
"""An increment that took this long [s] is waited for until the disk has it; one lost in a power cut before is not
worth it. Killed programs lose nothing either way."""
_DAMAGED = (
    OSError, ValueError, KeyError, TypeError, AttributeError, EOFError, MemoryError, NotImplementedError,
    RuntimeError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
_log = logging.getLogger("warp_trunk")


@dataclass(frozen=True, kw_only=True)
class _Record:
    """What stands beside the displacement of an increment, as JSON that may hold NaN and infinity."""

    format: int
    number: int
    load_factor: float
    seconds: float
    relaxation: Relaxation
    fingerprint: Fingerprint


class Checkpoint:
    """The folder `checkpoint` of a result: `increment_01.npz` and so on, one for each increment but the last.

    Each holds `displacement`, from rest in model order as the device has it [mm], shape (nodes, 3), and `record`,
    a JSON text: number, load factor, seconds, how the relaxation ended, and what the simulation depends on.
    """

    def __init__(self, result: Path, fingerprint: Fingerprint) -> None:
        self.folder = result / CHECKPOINT
        self._fingerprint = fingerprint

    def count(self) -> int:
        """How many increments it holds, from the first one on; one with a damaged file ends them.

        Raises:
            InputError: they are of another simulation.
        """
        number = 0
        while (record := _record(_path(self.folder, number + 1))) is not None:
            number += 1
            if differs := difference(record.fingerprint, self._fingerprint):
                raise InputError(
                    f"{self.folder}: is of another simulation, {differs}; "
                    "change it back, or leave --resume out to start anew"
                )
        return number

    def increments(self, model: Model) -> list[Increment]:
        """Those increments, to go on from with `simulate`."""
        return [_read(_path(self.folder, number), model) for number in range(1, self.count() + 1)]

    def save(self, increment: Increment) -> None:
        """Adds an increment; its file is whole or not there. A disk that fails is a warning."""
        path = _path(self.folder, increment.number)
        record = _Record(
            format=FORMAT,
            number=increment.number,
            load_factor=increment.load_factor,
            seconds=increment.seconds,
            relaxation=increment.relaxation,
            fingerprint=self._fingerprint,
        )
        try:
            self.folder.mkdir(exist_ok=True)
            with partial(path).open("wb") as file:
                np.savez(
                    file,
                    displacement=increment.from_rest,
                    record=np.array(json.dumps(msgspec.to_builtins(record))),
                )
            complete(path, to_disk=increment.seconds >= WORTH_WAITING)
        except OSError as error:
            partial(path).unlink(missing_ok=True)
            _log.warning("%s: not written (%s); --resume could not go on from it", path, error.strerror)

    def remove(self) -> bool:
        """Removes all of it; whether there was any."""
        there = self.folder.exists()
        if there:
            shutil.rmtree(self.folder)
        return there


def unfinished(result: Path) -> str:
    """What a simulation that has not ended left in a result folder, in words; empty where there is none."""
    if not (result / CHECKPOINT).is_dir():
        return ""
    number, increments = 0, "?"
    while (record := _record(_path(result / CHECKPOINT, number + 1))) is not None:
        number, increments = number + 1, record.fingerprint.get("increments", "?")
    return (
        f"an unfinished simulation, {number} of {increments} increments; "
        "if it no longer runs, simulate again with --resume to continue it"
    )


def _path(folder: Path, number: int) -> Path:
    return folder / f"increment_{number:02d}.npz"


def _record(path: Path) -> _Record | None:
    """What a file says of its increment; None where it is missing or damaged."""
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as file:
            finite = np.isfinite(file["displacement"]).all()
            record = msgspec.convert(json.loads(str(file["record"])), _Record)
        return record if record.format == FORMAT and finite else None
    except _DAMAGED:
        return None


def _read(path: Path, model: Model) -> Increment:
    with np.load(path, allow_pickle=False) as file:
        record = msgspec.convert(json.loads(str(file["record"])), _Record)
        displacement = file["displacement"]
    if displacement.shape != model.rest.shape:
        raise InputError(
            f"{path}: has {len(displacement)} nodes but the mesh has {len(model.rest)}; "
            "leave --resume out to start anew"
        )
    return Increment(
        model, record.number, record.load_factor, displacement, record.relaxation, seconds=record.seconds
    )
