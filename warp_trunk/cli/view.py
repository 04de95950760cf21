"""warp-trunk view"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from warp_trunk.recording import view, view_in_browser
from warp_trunk.results.result import find_recording


@dataclass(frozen=True, kw_only=True)
class View:
    """Open the recording of a result in the viewer."""

    result: Positional[Path]
    """Result folder, or a recording."""
    web: bool = False
    """Show it in a browser on this machine instead of a window."""

    def run(self, arguments: Sequence[str]) -> int:
        """Starts the viewer, which other machines cannot reach, and waits for its end."""
        recording = find_recording(self.result)
        show = view_in_browser if self.web else view
        return show(recording)
