"""warp-trunk view"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from ..errors import InputError
from ..recording import view, view_in_browser
from ..results import RECORDING, partial


@dataclass(frozen=True, kw_only=True)
class View:
    """Open the recording of a result in the viewer."""

    result: Positional[Path]
    """Result folder, or a recording."""
    web: bool = False
    """Show it in a browser on this machine instead of in a window."""

    def run(self, arguments: Sequence[str]) -> int:
        """Starts the viewer, which other machines cannot reach, and waits for its end."""
        show = view_in_browser if self.web else view
        return show(find_recording(self.result))


def find_recording(result: Path) -> Path:
    """The recording in a result folder, also one that was cut short; InputError where there is none."""
    if result.is_file():
        return result
    for path in (result / RECORDING, partial(result / RECORDING)):
        if path.is_file():
            return path
    raise InputError(f"{result}: holds no {RECORDING}; give a folder that was simulated with --record")
