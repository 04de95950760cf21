"""warp-trunk view"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from warp_trunk.errors import InputError
from warp_trunk.recording import view, view_in_browser
from warp_trunk.results import RECORDING, partial

_BEGINS = b"RRF"
"""How a recording of Rerun begins; its viewer would open much else."""


@dataclass(frozen=True, kw_only=True)
class View:
    """Open the recording of a result in the viewer."""

    result: Positional[Path]
    """Result folder, or a recording."""
    web: bool = False
    """Show it in a browser on this machine instead of in a window."""

    def run(self, arguments: Sequence[str]) -> int:
        """Starts the viewer, which other machines cannot reach, and waits for its end."""
        recording = find_recording(self.result)
        show = view_in_browser if self.web else view
        return show(recording)


def find_recording(result: Path) -> Path:
    """The recording in a result folder, also one that was cut short; InputError where there is none."""
    if result.is_file():
        with result.open("rb") as file:
            if not file.read(len(_BEGINS)) == _BEGINS:
                raise InputError(f"{result}: is no recording; give a result folder or the {RECORDING} in it")
        return result
    for path in (result / RECORDING, partial(result / RECORDING)):
        if path.is_file():
            return path
    raise InputError(f"{result}: holds no {RECORDING}; give a folder that was simulated with --record")
