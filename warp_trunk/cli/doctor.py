"""warp-trunk doctor"""

from dataclasses import dataclass
from pathlib import Path

from warp_trunk.run.doctor import examine

from .output import INCOMPLETE, OK


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Check the installation and name the cure for what is missing."""

    results: Path = Path("results")
    """Folder for results."""

    def run(self) -> int:
        """Prints the findings; status 3 where something is missing without which nothing runs."""
        ready = True
        for finding in examine(self.results):
            mark = "ok" if not finding.cure else "MISSING" if finding.needed else "note"
            ready &= not (finding.cure and finding.needed)
            print(f"{mark:<8}{finding.name:<20}{finding.answer}")
            if finding.cure:
                print(f"{'':<8}{'':<20}-> {finding.cure}")
        print("\nReady." if ready else "\nNot ready: see the lines marked MISSING.")
        return OK if ready else INCOMPLETE
