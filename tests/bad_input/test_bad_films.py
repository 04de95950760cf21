"""Films that are not what `triangulate` needs: one line, nothing left behind."""

from pathlib import Path

import numpy as np
import pytest

from support.biplanar import biplanar
from support.small_case import small_case


def films(folder: Path) -> list[str]:
    """Two good films and their flags."""
    flags = []
    for flag, film in zip(("pa", "lateral"), biplanar(small_case().landmarks_before), strict=True):
        rows = [f"{name},{u!r},{v!r}" for name, (u, v) in zip(film.names, film.points.tolist(), strict=True)]
        (folder / f"{flag}.csv").write_text("\n".join(["name,u,v", *rows]))
        np.savetxt(folder / f"{flag}.txt", film.projection)
        flags += [f"--{flag}", str(folder / f"{flag}.csv"), f"--{flag}-matrix", str(folder / f"{flag}.txt")]
    return flags


FILMS = [
    ("no film", "pa.csv", None, "pa.csv: there is no such file"),
    ("no matrix", "lateral.txt", None, "lateral.txt: there is no such file"),
    ("a column less", "pa.csv", "name,u\na,1\n", "the first line must name the columns name,u,v"),
    ("a matrix of words", "pa.txt", "a b c d\n" * 3, "pa.txt: cannot be read"),
    ("two rows", "pa.txt", "1 2 3 4\n" * 2, "a projection is 3 by 4 finite numbers, not (2, 4)"),
    ("rows of other lengths", "pa.txt", "1 2 3 4\n1 2\n1 2 3 4\n", "pa.txt: cannot be read"),
    ("1e300", "pa.txt", "1e300 0 0 0\n0 1 0 0\n0 0 1 0\n", "3 by 4 finite numbers"),
    ("no source", "pa.txt", "1 0 0 4\n1 0 0 4\n0 0 1 4\n", "must be a regular matrix"),
    ("other landmarks", "pa.csv", "name,u,v\na,1,2\n", "pa.csv"),
]


@pytest.mark.parametrize("row", FILMS, ids=lambda row: row[0])
def test_broken_films_are_refused(refused, tmp_path, row):
    _, name, text, *fragments = row
    flags = films(tmp_path)
    (tmp_path / name).unlink()
    if text is not None:
        (tmp_path / name).write_text(text)
    refused(["triangulate", *flags, "--out", str(tmp_path / "out.csv")], *fragments)
    assert not (tmp_path / "out.csv").exists()
