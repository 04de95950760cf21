"""The trunk to turn: what it shows in a real browser, against rays and against its own parts."""

import json
from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from support.synthetic import grid_faces

pytest.importorskip("playwright", reason="playwright is not installed (uv sync installs it)")
from playwright.sync_api import Page, sync_playwright

from support.asserting import not_none
from support.chromium import CHROMIUM, WEBGL, needs_chromium
from support.report_results import write_small_result
from warp_trunk.io.surface_files import read_surface, write_surface
from warp_trunk.report.skin_pictures import looks
from warp_trunk.report.style import TrunkState, dressed
from warp_trunk.report.turning import TurningState, script, turning
from warp_trunk.report.writing import poses_of, write_report
from warp_trunk.results import read_result
from warp_trunk.views.clothing import COLUMNS, SHIRT, SHORTS, cloth_of
from warp_trunk.views.relief import BEHIND, RIGHT, Viewpoint


def test_twenty_thousand_vertices_take_less_than_a_megabyte_and_a_half() -> None:
    turn, up = np.meshgrid(np.linspace(0, 2 * np.pi, 200, endpoint=False), np.linspace(0, 600, 100))
    faces = grid_faces(100, 200, closed=True)
    random = np.random.default_rng(1)
    states = []
    for wave in (0.0, 20.0, 25.0, 15.0):
        radius = 120.0 + wave * np.sin(up / 90.0 + turn) + random.normal(0.0, 0.1, up.shape)
        skin = np.stack([1.4 * radius * np.cos(turn), radius * np.sin(turn), up], axis=-1).reshape(-1, 3)
        cloth = 1.03 * skin[:: len(skin) // ((SHORTS + SHIRT) * COLUMNS)][: (SHORTS + SHIRT) * COLUMNS]
        hump = 20.0 * np.sin(turn).ravel()
        states.append(
            TurningState(f"state {wave}", skin, cloth.reshape(-1, COLUMNS, 3), hump, np.abs(hump) / 20.0)
        )
    colours = random.integers(0, 256, (20_000, 3), np.uint8)
    packed = turning(states, faces, colours=colours, bare=False)
    assert len(json.dumps(packed.info)) + len(packed.data) + len(script()[0]) < 1.5e6


def test_a_lower_cut_that_is_not_level_leaves_the_shorts_as_wide_as_the_skin(tmp_path: Path) -> None:
    """The lowest section is a part of the trunk, at its left edge alone."""
    pose = poses_of(read_result(write_small_result(tmp_path)))[0]
    skin = pose.skin.vertices
    low = np.exp(-(skin[:, 2] - skin[:, 2].min()) / 20.0)
    tilted = pose.skin.moved(skin - np.outer(0.04 * skin[:, 0] * low, [0.0, 0.0, 1.0]))
    level, shorts = (cloth_of(surface, pose.landmarks)[:SHORTS, :, :2] for surface in (pose.skin, tilted))
    assert np.abs(shorts - level).max() < 5.0


def test_a_shirt_shows_no_small_peak_of_the_skin(tmp_path: Path) -> None:
    pose = poses_of(read_result(write_small_result(tmp_path)))[0]
    skin, front = pose.skin.vertices, pose.skin.vertices[:, 1].min()
    tip = np.array([0.0, front, 0.5 * (skin[:, 2].min() + skin[:, 2].max())])
    bump = np.exp(-(((np.linalg.norm(skin - tip, axis=1)) / 10.0) ** 2))
    peaked = replace(pose, skin=pose.skin.moved(skin - np.outer(12.0 * bump, [0.0, 1.0, 0.0])))

    def highest(state: TrunkState) -> tuple[float, float]:
        """How far the cloth stands out, and its sharpest bend from row to row [mm]."""
        depth = -not_none(dressed([state])[0].worn).cloth[:, 3 * COLUMNS // 4, 1]
        return depth.max(), float(np.abs(np.diff(depth[SHORTS + 5 : -15], 2)).max())

    (flat, _), (out, bent) = highest(pose), highest(peaked)
    assert 4.0 < out - flat < 14.0
    assert bent < 1.0


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_small_result(tmp_path_factory.mktemp("turning"))
    for name in ("skin_before.ply", "predicted_skin.ply"):  # red on the left, blue on the right
        skin = read_surface(folder / name)
        colours = np.where(skin.vertices[:, :1] > 0.0, [200, 90, 80], [90, 90, 200]).astype(np.uint8)
        write_surface(folder / name, replace(skin, colours=colours))
    return folder


@pytest.fixture(scope="module")
def page(result: Path) -> Iterator[Page]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(WEBGL))
        tab = browser.new_context(offline=True, has_touch=True).new_page()
        said: list[str] = []
        tab.on("console", lambda message: said.append(message.text))
        tab.on("pageerror", lambda error: said.append(str(error)))
        tab.goto(write_report(read_result(result)).resolve().as_uri())
        tab.wait_for_selector("#turning[data-ready]")
        yield tab
        assert said == []
        browser.close()


def picture(page: Page) -> np.ndarray:
    """The picture on the canvas, shape (rows, columns, 3)."""
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    shot = page.locator("#turning canvas").screenshot()
    return np.asarray(Image.open(BytesIO(shot)).convert("RGB"), dtype=np.float64)


def set_to(page: Page, look: str = "", slider: int = 0) -> None:
    """Choose looks, and the place of the slider; everything else as the page begins."""
    for box in page.locator("#turning [data-look]").all():
        box.set_checked(box.get_attribute("data-look") in look.split())
    page.get_by_role("button", name="Behind").click()
    place = "(e, v) => { e.value = v; e.dispatchEvent(new Event('input', {bubbles: true})) }"
    page.locator("#turning [data-part=slider]").evaluate(place, slider)


@needs_chromium
@pytest.mark.slow
@pytest.mark.parametrize(("button", "view"), [("Behind", BEHIND), ("Right", RIGHT)])
@pytest.mark.parametrize("predicted", [0, 1])
def test_outline_is_that_of_rays(page: Page, result: Path, button: str, view: Viewpoint, predicted: int) -> None:
    set_to(page, "shirt", slider=100 * predicted)
    page.get_by_role("button", name=button).click()
    seen = picture(page).min(axis=2) < 250.0
    poses = dressed(poses_of(read_result(result)))
    _, reliefs = looks(poses, view, wear="shirt")
    expected = np.isfinite(reliefs[predicted].depth)
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    bar = not_none(page.locator("#turning [data-part=bar]").bounding_box())
    pixels = bar["width"] / 100.0  # for each mm
    wide = [expected.any(axis=0).sum(), expected.any(axis=1).sum()]
    assert len(columns) / pixels == pytest.approx(wide[0], abs=4.0)
    top = seen[rows[0] : rows[0] + int(200 * pixels)]  # below, the rays end at the pelvis
    rows = np.flatnonzero(expected.any(axis=1))
    share = expected[rows[0] : rows[0] + 200].mean(axis=1) * expected.shape[1]
    drawn = top.sum(axis=1) / pixels
    apart = np.abs(np.interp(np.arange(5.0, 195.0), np.arange(len(drawn)) / pixels, drawn) - share[5:195])
    assert apart.mean() < 1.5
    assert apart.max() < 10.0  # where shoulders slope, a row lower is some mm wider


@needs_chromium
@pytest.mark.slow
def test_wipe_shows_each_state_on_its_side(page: Page) -> None:
    set_to(page)
    before = picture(page)
    set_to(page, slider=100)
    predicted = picture(page)
    set_to(page, "wipe", slider=50)
    wiped, half = picture(page), before.shape[1] // 2
    assert np.abs(wiped[60:, : half - 4] - before[60:, : half - 4]).mean() < 0.5  # names stand above
    assert np.abs(wiped[60:, half + 4 :] - predicted[60:, half + 4 :]).mean() < 0.5
    assert np.abs(before - predicted).mean() > 1.0
    for part, name in (("wiped", "Before surgery"), ("kept", "Predicted")):  # each on the side that it names
        label = page.locator(f"#turning [data-part={part}]")
        assert label.inner_text() == name
        box, stage = not_none(label.bounding_box()), not_none(page.locator("#turning canvas").bounding_box())
        at = box["x"] + 0.5 * box["width"] - stage["x"]
        assert (at < 0.5 * stage["width"]) == (name == "Before surgery")
    set_to(page, slider=50)
    assert np.abs(picture(page) - wiped).mean() > 0.5


@needs_chromium
@pytest.mark.slow
def test_mouse_finger_and_keys_turn_it(page: Page) -> None:
    def yaw() -> float:
        return float(page.locator("#turning").get_attribute("data-yaw") or "nan")

    set_to(page)
    box = not_none(page.locator("#turning canvas").bounding_box())
    x, y = box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 100.0, y)
    page.mouse.up()
    picture(page)
    assert yaw() == pytest.approx(1.0)
    set_to(page)
    page.locator("#turning canvas").press("ArrowLeft")
    picture(page)
    assert yaw() == pytest.approx(0.2)
    page.locator("#turning canvas").press("Home")
    touch = {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]}
    session = page.context.new_cdp_session(page)
    session.send("Input.dispatchTouchEvent", touch)
    for way in (20.0, 40.0, 60.0):
        session.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [{"x": x + way, "y": y}]})
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    picture(page)
    assert yaw() < -0.2


@needs_chromium
@pytest.mark.slow
def test_front_is_never_bare_and_back_is_unless_in_a_shirt(page: Page) -> None:
    def blue(shown: np.ndarray) -> float:
        middle = shown[shown.shape[0] // 3, shown.shape[1] // 2]
        return middle[2] - middle[0]

    set_to(page)
    assert blue(picture(page)) < 0.0
    page.get_by_role("button", name="Front").click()
    assert blue(picture(page)) > 10.0
    set_to(page, "shirt")
    assert blue(picture(page)) > 10.0
    set_to(page, "hump", slider=100)
    coloured = picture(page)
    set_to(page, slider=100)
    assert np.abs(coloured - picture(page)).max() > 20.0


@needs_chromium
@pytest.mark.slow
def test_skin_has_the_colours_of_its_scan_or_none(page: Page) -> None:
    def red(shown: np.ndarray) -> list[float]:
        row = shown[shown.shape[0] // 3]
        left, right = (row[:, 0] - row[:, 2])[(row.min(axis=1) < 240.0)][[20, -20]]
        return [left, right]

    set_to(page, "own")
    left, right = red(picture(page))
    assert left > 50.0
    assert right < -50.0
    assert page.get_by_alt_text("in the colours of the scan").count() == 1
    set_to(page)
    assert max(map(abs, red(picture(page)))) < 30.0
