"""Which cases a cohort has, and where their results go."""

from __future__ import annotations

from pathlib import Path

from warp_trunk.case.case_writer import HEADER, refuse_case
from warp_trunk.errors import InputError
from warp_trunk.io.folders import make_writable

from .record import JUDGED


def case_folders(folder: Path) -> list[Path]:
    """The case folders in a folder, by name.

    Raises:
        InputError: there is no such folder, it is itself a case, or it holds none.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; give the one that holds the case folders")
    if (folder / HEADER).is_file():
        raise InputError(f"{folder}: is one case; give the folder that holds it and the others, or use simulate")
    found = sorted(path.parent for path in folder.glob(f"*/{HEADER}"))
    if not found:
        raise InputError(
            f"{folder}: holds no case folder, which is one with {HEADER} in it; make cases with warp-trunk "
            "import, plan or make-case"
        )
    return found


def check_out(out: Path, folder: Path, names: list[str]) -> list[str]:
    """Makes the folder of a cohort's results; reports results in it that belong to no case any more.

    Raises:
        InputError: it lies in a case, or is the folder of the cases, or cannot be written to.
    """
    refuse_case(out)
    if out.resolve() == folder.resolve():
        raise InputError(f"{out}: holds the cases; give --out another folder")
    make_writable(out, "results")
    return sorted({path.parent.name for path in out.glob(f"*/{JUDGED}")} - set(names))
