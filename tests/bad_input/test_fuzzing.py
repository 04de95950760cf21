"""No file, however broken, makes a reader do anything but read it or refuse it in one line.

The same damage on every machine; `pytest -m search` tries new damage, see docs/testing.md.
"""

import os
import re
import secrets
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from voxelise_case import write_labels

from support.biplanar import biplanar, write_film
from support.label_maps import write_nrrd
from support.report_results import write_small_result
from support.small_case import small_case
from support.small_trunk import boned_case
from warp_trunk.bone_motion.plan import read_plan
from warp_trunk.case.header import read_header
from warp_trunk.case.landmarks import read_landmarks, write_landmarks
from warp_trunk.case.layers import read_numbers
from warp_trunk.case.motions import read_motions
from warp_trunk.case.tissue_file import read_tissue_file
from warp_trunk.engine.tissue import Tissue
from warp_trunk.errors import InputError
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.image_files.image_reader import read_labels, read_scan
from warp_trunk.io.surface_files import read_surface, write_surface
from warp_trunk.io.transform_file import read_transform
from warp_trunk.io.trunk_file import read_trunk
from warp_trunk.io.volume_reader import read_volume
from warp_trunk.io.volume_writer import write_volume
from warp_trunk.meshing import cache
from warp_trunk.meshing.layers import labels_from_mesh
from warp_trunk.preparation.label_maps.sources import label_table
from warp_trunk.preparation.reconstruction.triangulation import read_film, read_projection
from warp_trunk.results import read_result

VTK = Path(__file__).parents[1] / "support" / "vtk_files"
PYRAMID = read_surface(VTK / "ascii.vtp")


RAW = re.compile(
    r"\w+(?:Error|Exception|Warning)\b|could not convert|cannot reshape|zip\(|invalid literal|out of bounds|"
    r"argument \d|not enough values|too many values|buffer size|unpack requires|object has no|object is not|"
    r"NoneType|codec|dimension mismatch|inhomogeneous"
)
"""Messages of libraries about their own code, which are no use to whoever gave a file."""
NUMBERS = (b"0", b"-1", b"3", b"nan", b"inf", b"1e308", b"-1e-320", b"4294967295", b"9" * 20, b"1_0", b"")
BITS = (b"\x00", b"\n", b'"', b",", b"\xef\xbb\xbf", b"\xff" * 8, b"<a>", b"[" * 50, b"#", b"\xed\xa0\x80")
A_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", re.IGNORECASE)


def damaged(seed: int, good: bytes) -> bytes:
    """A few changes to a file, half of them in its header, or bytes that never were one."""
    random, content = np.random.RandomState(seed), good  # whose numbers are the same in every version of NumPy
    if random.rand() < 0.1:
        return random.bytes(random.randint(300))
    for _ in range(random.randint(1, 5)):
        at = random.randint(1 + (len(content) if random.rand() < 0.5 else min(len(content), 400)))
        count = (1, 4, 30, 200, 10**9)[random.randint(5)]
        number = A_NUMBER.search(content, at)
        start, end = number.span() if number else (at, at)
        content = (
            content[:at] + random.bytes(1) + content[at + 1 :],
            content[:at] + content[at + count :],
            content[: at + count] + content[at:],
            content[:start] + NUMBERS[random.randint(len(NUMBERS))] + content[end:],
            content[:at] + BITS[random.randint(len(BITS))] + content[at:],
        )[random.randint(5)]
    return content


def surface_file(path: Path) -> None:
    write_surface(path, PYRAMID)


def vtk_file(path: Path) -> None:
    path.write_bytes((VTK / path.name).read_bytes())


def text_file(text: str) -> Callable[[Path], object]:
    return lambda path: path.write_text(text, encoding="utf-8")


def landmarks_file(path: Path) -> None:
    landmarks = small_case().landmarks_before
    write_landmarks(path, type(landmarks)(landmarks.names[:4], landmarks.points[:4]))


def film_file(path: Path) -> None:
    write_film(path, path.with_suffix(".txt"), biplanar(small_case().landmarks_before)[0])


def volume_file(path: Path) -> None:
    trunk = boned_case()[1]
    write_volume(path, trunk, np.zeros_like(trunk.nodes), Tissue())


def image_file(path: Path) -> None:
    labels = np.zeros((6, 7, 8), dtype=np.int16)
    labels[2:4, 3:5, 3:6] = 5
    affine = np.diag([2.0, 2.0, 2.0, 1.0])
    if path.name.endswith(".nrrd"):
        write_nrrd(path, labels, affine, {"Segment0_Name": "T8", "Segment0_LabelValue": "5"})
    else:
        write_labels(path, labels, affine, {5: "vertebrae_T8"})


def labelled_file(path: Path) -> None:
    import meshio

    trunk = boned_case()[1]
    cells: Any = [("tetra", trunk.tets)]
    meshio.vtu.write(path, meshio.Mesh(trunk.nodes, cells, cell_data={"tissue": [np.ones(len(trunk.tets), int)]}))


def cached_file(path: Path) -> None:
    """In the cache folder, which is the folder of the path."""
    cache.store_cached("0" * 64, boned_case()[1])


def read_volume_of_case(path: Path) -> object:
    case = boned_case()[0]
    return read_volume(path, case.skin, case.bones)


MARKUPS = (
    '{"markups": [{"coordinateSystem": "LPS", "coordinateUnits": "mm", "controlPoints": ['
    '{"label": "a", "position": [1.0, 2.0, 3.5], "positionStatus": "defined"}, '
    '{"label": "b", "position": [1.0, 2.0, -3.5]}]}]}'
)
FCSV = "# CoordinateSystem = LPS\n# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label\n1,0,1.5,2,0,0,0,1,1,1,0,a\n"
TOML = (
    'name = "a"\nunits = "mm"\naxes = "LPS"\nlandmark_columns = ["n", "x", "y", "z"]\n[tissue]\ntheta = 7\n'
    '[layers]\nskin_thickness = 1.5\nfat_thickness = "fat.txt"\n[layers.fat]\nyoungs_modulus = 3\n'
)
TISSUE = "[tissue]\ntheta = 7\n[layers.fat]\ndensity = 900\n[ribs]\naxial_rotation = 0.5\n"
PLAN = 'uiv = "T4"\nliv = "L1"\nunfused = "fixed"\n[[curve]]\napex = "T8"\ncorrection = 0.65\n'
MOTIONS = (
    "[sternum]\ntranslation = [0, -6, 0]\nrotation = { degrees = 2.0, axis = [1, 0, 0], point = [0, 0, 0] }\n"
    "[hyoid]\nfollows = { sternum = 0.5 }\n"
)
MATRIX = "1 0 0 5\n0 1 0 6\n0 0 1 7\n0 0 0 1\n"
READERS: dict[str, tuple[str, Callable[[Path], object], Callable[[Path], object]]] = {
    **{name: (f"a{name}", surface_file, read_surface) for name in (".ply", ".stl", ".obj", ".off", ".glb")},
    "ascii.ply": ("a.ply", text_file(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    ), read_surface),
    "ascii.stl": ("a.stl", text_file(
        "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
        "endsolid a\n"
    ), read_surface),
    **{path.name: (path.name, vtk_file, read_surface) for path in sorted(VTK.iterdir())},
    "landmarks.csv": ("a.csv", landmarks_file, read_landmarks),
    "landmarks.mrk.json": ("a.mrk.json", text_file(MARKUPS), read_landmarks),
    "landmarks.fcsv": ("a.fcsv", text_file(FCSV), read_landmarks),
    "case.toml": ("case.toml", text_file(TOML), read_header),
    "tissue.toml": ("tissue.toml", text_file(TISSUE), read_tissue_file),
    "plan.toml": ("plan.toml", text_file(PLAN), read_plan),
    "motions.toml": ("motions.toml", text_file(MOTIONS), read_motions),
    "thickness": ("a.txt", text_file("1.5\n2\n0.5 # thin\n"), lambda path: read_numbers(path, 3)),
    "transform": ("a.txt", text_file(MATRIX), read_transform),
    "projection": ("a.txt", text_file("1 0 0 5\n0 1 0 6\n0 0 1 7\n"), read_projection),
    "film": ("a.csv", film_file, lambda path: read_film(path, path.with_suffix(".txt"))),
    "labels": ("a.vtu", labelled_file, lambda path: labels_from_mesh(boned_case()[1], path)),
    "labels .nii": ("a.nii", image_file, read_labels),
    "labels .nii.gz": ("a.nii.gz", image_file, read_labels),
    "labels .seg.nrrd": ("a.seg.nrrd", image_file, read_labels),
    "scan .nii.gz": ("a.nii.gz", image_file, read_scan),
    "label table": ("a.csv", text_file("number,name\n5,vertebrae_T8\n"), lambda path: label_table(str(path))),
    "trunk.vtu": ("a.vtu", volume_file, read_trunk),
    **{name: (f"a{name}", volume_file, read_volume_of_case) for name in (".vtu", ".vtk", ".xdmf", ".msh", ".inp")},
    "mesh cache": (f"mesh-{'0' * 64}.npz", cached_file, lambda path: cache.load_cached("0" * 64)),
    **{name: (name, lambda path: write_small_result(path.parent), lambda path: read_result(path.parent))
       for name in ("summary.json", "landmarks_after.csv")},
}  # fmt: skip


def gigabytes() -> float:
    """Memory of the process [GB]."""
    return psutil.Process().memory_info().rss / 1e9


def read_damaged(reader: str, folder: Path, seeds: Iterable[int]) -> None:
    """Each seed damages the reader's good file in its own way; all are read or refused in one line."""
    name, write, read = READERS[reader]
    path = folder / name
    write(path)
    good = path.read_bytes()
    read(path)  # as it is, it is read
    for seed in seeds:
        path.write_bytes(damaged(seed, good))
        try:
            read_or_refused(path, folder, read)
        except BaseException as error:
            error.add_note(f"{reader}: damaged by seed {seed}")
            raise


def read_or_refused(path: Path, folder: Path, read: Callable[[Path], object]) -> None:
    before, said, content = gigabytes(), str(folder), None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        try:
            content = read(path)
        except InputError as error:
            said = str(error)
    if isinstance(content, Surface):
        assert np.isfinite(content.vertices).all()
        assert 0 <= content.faces.min() <= content.faces.max() < len(content.vertices)
    assert (str(folder) in said, len(said.splitlines())) == (True, 1)
    assert not RAW.search(said), said
    assert len(said) < 1000
    assert gigabytes() - before < 1.0


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("search", [False, pytest.param(True, marks=pytest.mark.search)])
def test_a_damaged_file_is_read_or_refused_in_one_line(
    reader: str, search: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With new seeds, as many as WARP_TRUNK_SEARCH says, for `pytest -m search`."""
    monkeypatch.setenv("WARP_TRUNK_CACHE", str(tmp_path))
    fresh = (secrets.randbits(32) for _ in range(int(os.environ.get("WARP_TRUNK_SEARCH", "100"))))
    read_damaged(reader, tmp_path, fresh if search else range(15))
