"""The commands that make a case of what a clinic measures, on the phantom."""

import numpy as np
import pytest

from support.biplanar import biplanar, write_film
from warp_trunk.case.landmarks import Landmarks, read_landmarks, write_landmarks
from warp_trunk.cli import main
from warp_trunk.io.surface_files import read_surface, write_surface
from warp_trunk.preparation.phantom import straight_trunk


def write_films(folder, films) -> list[str]:
    flags = []
    for flag, film in zip(("pa", "lateral"), films, strict=True):
        points, matrix = folder / f"{flag}.csv", folder / f"{flag}.txt"
        write_film(points, matrix, film)
        flags += [f"--{flag}", str(points), f"--{flag}-matrix", str(matrix)]
    return flags


def test_triangulate_writes_landmarks_that_a_case_reads(tmp_path, capsys) -> None:
    landmarks = straight_trunk()[2]
    out = tmp_path / "landmarks.csv"
    assert main(["triangulate", *write_films(tmp_path, biplanar(landmarks)), "--out", str(out)]) == 0
    np.testing.assert_allclose(read_landmarks(out).points, landmarks.points, atol=1e-6)
    said = capsys.readouterr().out
    assert f"{len(landmarks.names)} landmarks" in said
    assert "Reprojection error: mean 0.00" in said


@pytest.mark.parametrize("folds", [False, True])
def test_register_writes_the_skin_or_refuses_a_fold(tmp_path, capsys, folds: bool) -> None:
    skin = straight_trunk()[0]
    rows = np.arange(0, len(skin.vertices), len(skin.vertices) // 20)
    names = tuple(f"marker_{i}" for i in range(len(rows)))
    targets = skin.vertices[rows] + [5.0, -80.0, 2.0]
    if folds:
        near = np.argsort(np.linalg.norm(targets - targets[0], axis=1))[1]
        targets[[0, near]] = targets[[near, 0]]
    write_surface(tmp_path / "scan.ply", skin)
    write_landmarks(tmp_path / "skin.csv", Landmarks(names, skin.vertices[rows]))
    write_landmarks(tmp_path / "films.csv", Landmarks(names, targets))
    flags = ["--skin", "scan.ply", "--on-skin", "skin.csv", "--on-films", "films.csv", "--out", "skin.ply"]
    flags = [flag if flag.startswith("--") else str(tmp_path / flag) for flag in flags]
    status = main(["register", *flags])
    said = capsys.readouterr()
    if folds:
        assert status == 2
        assert "fold the skin" in said.err
        return
    assert status == 0
    assert "Rigid part: turns by 0.00 degrees" in said.out
    moved = read_surface(tmp_path / "skin.ply").vertices
    np.testing.assert_allclose(moved - skin.vertices, np.tile([5.0, -80.0, 2.0], (len(moved), 1)), atol=1e-7)
