"""Colours of a scan: each kind of file keeps them, and no other file than its own textures is opened."""

import json

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from support.asserting import not_none
from warp_trunk.geometry.coarsening import without_slivers
from warp_trunk.geometry.colours import as_colours, coloured_from
from warp_trunk.geometry.surface import Surface
from warp_trunk.io.point_files import read_back
from warp_trunk.io.surface_files import read_surface, write_surface
from warp_trunk.io.surface_files.morph import skin_glb

BALL = trimesh.creation.icosphere(subdivisions=3, radius=100.0)
SKIN = Surface(np.asarray(BALL.vertices), np.asarray(BALL.faces, dtype=np.int32))


def of(vertices):
    """A smooth colour of each place of the ball, 0 to 255."""
    return np.rint(127.5 + 1.2 * vertices).astype(np.uint8)


COLOURS = of(SKIN.vertices)
COLOURED = Surface(SKIN.vertices, SKIN.faces, COLOURS)


def colours_of(surface: Surface) -> np.ndarray:
    assert surface.colours is not None
    return surface.colours


@pytest.mark.parametrize("ending", ["ply", "obj", "glb"])
def test_colours_that_are_written_come_back(tmp_path, ending):
    path = tmp_path / f"skin.{ending}"
    write_surface(path, COLOURED)
    np.testing.assert_array_equal(read_surface(path).colours, COLOURS)
    write_surface(path, SKIN)
    assert read_surface(path).colours is None


@pytest.mark.parametrize("kind", ["uchar", "float of 1", "float of 255", "ushort", "OBJ of 1", "OBJ of 255"])
def test_numbers_of_every_range_are_told_apart(tmp_path, kind):
    most = 1.0 if kind.endswith("1") else 65535.0 if kind == "ushort" else 255.0
    rows = np.column_stack([SKIN.vertices, COLOURS * (most / 255.0)]).tolist()
    if kind.startswith("OBJ"):
        lines = [f"v {' '.join(map(repr, row))}" for row in rows]
        lines += [f"f {a} {b} {c}" for a, b, c in SKIN.faces + 1]
    else:
        name = kind.split()[0]
        number = (lambda value: str(round(value))) if name.startswith("u") else repr
        lines = ["ply", "format ascii 1.0", f"element vertex {len(rows)}"]
        lines += [f"property double {axis}" for axis in "xyz"]
        lines += [f"property {name} {colour}" for colour in ("red", "green", "blue")]
        lines += [f"element face {len(SKIN.faces)}", "property list uchar int vertex_indices", "end_header"]
        lines += [" ".join([*map(repr, row[:3]), *map(number, row[3:])]) for row in rows]
        lines += [f"3 {a} {b} {c}" for a, b, c in SKIN.faces]
    path = tmp_path / ("a.obj" if kind.startswith("OBJ") else "a.ply")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    np.testing.assert_array_equal(read_surface(path).colours, COLOURS)
    points, colours = read_back(path)
    assert colours is not None
    assert len(points) == len(colours) > len(SKIN.vertices)


def test_missing_colours_come_from_the_nearest_vertex_and_one_colour_says_nothing():
    values = COLOURS.astype(float)
    values[SKIN.vertices[:, 2] > 60.0] = np.nan
    colours = not_none(as_colours(values, SKIN.vertices))
    up = SKIN.vertices[:, 2] > 60.0
    np.testing.assert_array_equal(colours[~up], COLOURS[~up])
    assert np.abs(colours[up, 2] - of(np.array([[0.0, 0, 60]]))[0, 2].astype(float)).max() < 25.0
    assert as_colours(np.full((9, 3), np.nan), np.eye(9)[:, :3]) is None
    assert as_colours(np.full((9, 4), 204.0), np.eye(9)[:, :3]) is None


def textured(folder, *, names=("skin.mtl", "skin.png")):
    """The ball as scanners write it: each triangle has a patch of its own in a picture that is black elsewhere."""
    side = int(np.ceil(np.sqrt(len(SKIN.faces))))
    picture, cell = np.zeros((8 * side, 8 * side, 3), dtype=np.uint8), 8
    corners = np.array([[1.0, 1.0], [7.0, 1.0], [1.0, 7.0]])
    lines = [f"mtllib {names[0]}"] + ["v {} {} {}".format(*point) for point in SKIN.vertices.tolist()]
    places, faces = [], []
    for number, face in enumerate(SKIN.faces):
        left, low = cell * (number % side), cell * (number // side)
        middle = of(SKIN.vertices[face].mean(axis=0)[None])[0]
        x, y = np.meshgrid(np.arange(8), np.arange(8))
        picture[low : low + 8, left : left + 8][x + y < 9] = middle
        uv = (corners + np.array([left, low])) / (8.0 * side)
        places += [f"vt {u} {1.0 - v}" for u, v in uv]
        faces.append("f " + " ".join(f"{c + 1}/{3 * number + k + 1}" for k, c in enumerate(face)))
    (folder / "skin.obj").write_text("\n".join([*lines, *places, "usemtl photo", *faces]), encoding="utf-8")
    (folder / "skin.mtl").write_text(
        f"newmtl photo\nKd 0.5 0.5 0.5\nmap_Kd -s 1 1 1 {names[1]}\n", encoding="utf-8"
    )
    Image.fromarray(picture).save(folder / "skin.png")
    return picture


def test_the_texture_of_an_obj_is_baked_and_keeps_away_from_its_seams(tmp_path):
    textured(tmp_path)
    surface = read_surface(tmp_path / "skin.obj")
    np.testing.assert_array_equal(surface.faces, SKIN.faces)
    assert np.abs(colours_of(surface).astype(float) - COLOURS).max() < 15.0  # of a triangle's half width


@pytest.mark.parametrize("missing", ["skin.mtl", "skin.png"])
def test_a_texture_that_is_not_there_leaves_the_colours_out_with_a_warning(tmp_path, caplog, missing):
    textured(tmp_path)
    (tmp_path / missing).unlink()
    surface = read_surface(tmp_path / "skin.obj")
    assert surface.colours is None
    assert len(surface.faces) == len(SKIN.faces)
    assert f"{missing}: " in caplog.text


def test_a_texture_outside_its_folder_is_not_opened(tmp_path, caplog):
    (tmp_path / "in").mkdir()
    textured(tmp_path / "in", names=("skin.mtl", "../skin.png"))
    (tmp_path / "in" / "skin.png").rename(tmp_path / "skin.png")
    assert read_surface(tmp_path / "in" / "skin.obj").colours is None
    assert "outside" in caplog.text


def test_the_texture_of_a_glb_is_baked(tmp_path):
    soup = SKIN.vertices[SKIN.faces]
    uv = np.column_stack([soup.reshape(-1, 3)[:, 0] + 100.0, soup.reshape(-1, 3)[:, 2] + 100.0]) / 200.0
    level = np.rint(np.linspace(0, 255, 256)).astype(np.uint8)
    picture = np.zeros((256, 256, 3), dtype=np.uint8)
    picture[..., 0], picture[..., 1] = level[None], level[::-1, None]
    mesh = trimesh.Trimesh(soup.reshape(-1, 3), np.arange(soup.size // 3).reshape(-1, 3), process=False)
    mesh.visual = TextureVisuals(uv=uv, material=PBRMaterial(baseColorTexture=Image.fromarray(picture)))
    mesh.export(tmp_path / "a.glb")
    surface = read_surface(tmp_path / "a.glb")
    assert len(surface.vertices) == len(SKIN.vertices)
    expected = 255.0 * (surface.vertices[:, [0, 2]] + 100.0) / 200.0
    assert np.abs(colours_of(surface)[:, :2] - expected).max() < 12.0
    assert not colours_of(surface)[:, 2].any()


@pytest.mark.parametrize("move", [{"offset": [0.25, 0.0], "scale": [0.5, 0.5]}, {"rotation": 0.5 * np.pi}])
def test_places_in_the_picture_of_a_glb_move_as_its_extension_says(tmp_path, move):
    """The same picture through KHR_texture_transform, whose formula is written out here, and without it."""
    uv = np.array([[0.2, 0.3], [0.8, 0.3], [0.5, 0.7], [0.2, 0.3], [0.5, 0.7], [0.3, 0.9]])
    level = np.arange(256, dtype=np.uint8)
    picture = np.zeros((256, 256, 3), dtype=np.uint8)
    picture[..., 0], picture[..., 1] = level[None], level[:, None]  # row and column from the upper left
    points = np.array([[0, 0, 0], [9, 0, 0], [5, 9, 0], [0, 0, 9], [5, 9, 9], [0, 9, 5]], dtype=float)
    mesh = trimesh.Trimesh(points, [[0, 1, 2], [3, 4, 5]], process=False)
    mesh.visual = TextureVisuals(uv=uv, material=PBRMaterial(baseColorTexture=Image.fromarray(picture)))
    content = mesh.export(file_type="glb")
    assert isinstance(content, bytes)
    length = int.from_bytes(content[12:16], "little")
    scene = json.loads(content[20 : 20 + length])
    extension = {"KHR_texture_transform": move}
    scene["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] = extension
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    parts = len(text).to_bytes(4, "little") + b"JSON" + text + content[20 + length :]
    (tmp_path / "a.glb").write_bytes(content[:8] + (12 + len(parts)).to_bytes(4, "little") + parts)
    u, v = uv.T * [[1.0], [-1.0]] + [[0.0], [1.0]]
    u, v = u * move.get("scale", [1, 1])[0], v * move.get("scale", [1, 1])[1]
    c, s = np.cos(move.get("rotation", 0.0)), np.sin(move.get("rotation", 0.0))
    u, v = c * u + s * v + move.get("offset", [0, 0])[0], -s * u + c * v + move.get("offset", [0, 0])[1]
    inside = colours_of(read_surface(tmp_path / "a.glb"))[:, :2].astype(float) / 255.0
    expected = np.column_stack([u % 1.0, v % 1.0])
    centre = np.repeat(expected.reshape(2, 3, 2).mean(axis=1), 3, axis=0)
    assert np.abs(inside - (0.4 * centre + 0.6 * expected)).max() < 0.12


def test_the_colours_of_a_morph_are_light_as_gltf_has_it(tmp_path):
    """128 of 255 on a screen is 0.2159 of its light (IEC 61966-2-1)."""
    colours = np.tile(np.array([128, 255, 0], dtype=np.uint8), (len(SKIN.vertices), 1))
    colours[0] = 0
    content = skin_glb(Surface(SKIN.vertices, SKIN.faces, colours), SKIN, ("a", "b"))
    (tmp_path / "a.glb").write_bytes(content)
    stored = next(iter(trimesh.load_scene(tmp_path / "a.glb").geometry.values())).visual.vertex_attributes["color"]
    np.testing.assert_allclose(stored[1, :3], [0.2159, 1.0, 0.0], atol=1e-4)
    back = read_surface(tmp_path / "a.glb")
    assert sorted(map(tuple, np.unique(colours_of(back), axis=0).tolist())) == [(0, 0, 0), (128, 255, 0)]
    plain = skin_glb(Surface(SKIN.vertices, SKIN.faces, colours), SKIN, ("a", "b"), plain=True)
    assert b"COLOR_0" not in plain


def test_colours_go_on_to_the_nearest_points_of_another_surface():
    ball = trimesh.creation.icosphere(subdivisions=2, radius=100.5)
    half = SKIN.faces[(SKIN.vertices[SKIN.faces][:, :, 0] > -10.0).all(axis=1)]
    other = SKIN.faces[(SKIN.vertices[SKIN.faces][:, :, 0] < 10.0).all(axis=1)]
    parts = [Surface(SKIN.vertices, part, COLOURS) for part in (half, other)]
    coloured = coloured_from(Surface(ball.vertices, ball.faces), [*parts, SKIN])
    assert np.abs(colours_of(coloured).astype(float) - of(ball.vertices / 1.005)).max() < 6.0
    bare = Surface(ball.vertices, ball.faces)
    assert coloured_from(bare, [SKIN]) is bare
    thin = SKIN.vertices.copy()
    a, b, _ = SKIN.faces[0]
    thin[a] = thin[b] + 0.004 * (thin[a] - thin[b])  # a sliver
    mended = without_slivers(Surface(thin, SKIN.faces, of(thin)))
    assert len(mended.vertices) < len(thin)
    assert np.abs(colours_of(mended).astype(float) - of(mended.vertices)).max() < 25.0
