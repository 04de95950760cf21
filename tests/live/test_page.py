"""The planning page in a real browser: drag, look, keep, compare, undo; two browsers, one of them killed."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from playwright.sync_api import Browser, Locator, Playwright, WebSocket, expect, sync_playwright
from playwright.sync_api import Page as Tab

from support.asserting import not_none
from support.axe import violations
from support.chromium import CHROMIUM, WEBGL, needs_chromium
from support.small_trunk import APEX, small_patient
from warp_trunk.bone_motion.plan import PlannedSurgery
from warp_trunk.live.planning_page import Page
from warp_trunk.live.sliders import Setting, SpineSliders
from warp_trunk.measures.rows import number as shown
from warp_trunk.recording.viewer import free_port

pytestmark = [needs_chromium, pytest.mark.slow]
WAIT = 90_000.0
"""Longest wait for the page [ms]."""
PANEL = '.mantine-Paper-root[style*="position: fixed"]'
"""The panel that viser lays over the picture on a phone."""
RELAXED = "solved to"
"""Status after the skin is relaxed to the end."""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    folder = tmp_path_factory.mktemp("live") / "plans"
    patient = small_patient()
    skin = patient.case.skin
    colours = np.where(skin.vertices[:, :1] > 0.0, [200, 90, 80], [90, 90, 200]).astype(np.uint8)
    patient = replace(patient, case=replace(patient.case, skin=replace(skin, colours=colours)))
    with Page(patient, SpineSliders(patient.case), folder, free_port()) as page:
        yield page
        assert page.failure is None


@pytest.fixture(scope="module")
def playwright() -> Iterator[Playwright]:
    with sync_playwright() as playwright:
        yield playwright


def launch(playwright: Playwright) -> Browser:
    return playwright.chromium.launch(executable_path=CHROMIUM, args=list(WEBGL))


@pytest.fixture(scope="module")
def browser(playwright: Playwright) -> Iterator[Browser]:
    browser = launch(playwright)
    yield browser
    browser.close()


class Visit:
    """A tab with the page, and what it said, asked for and was sent."""

    def __init__(self, browser: Browser, page: Page, width: int = 1000) -> None:
        self.complaints: list[str] = []
        self.elsewhere: list[str] = []
        self.sent: list[int] = []
        self.tab: Tab = browser.new_page(
            viewport={"width": width, "height": 600}
        )  # small: it is drawn without a GPU
        self.tab.set_default_timeout(WAIT)
        self.tab.on("console", lambda said: self.complaints.extend([said.text] * (said.type == "error")))
        self.tab.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.tab.on("request", lambda request: self._asked(request.url, page.server.address))
        self.tab.on("websocket", self._connected)
        self.tab.goto(page.server.address)
        self.wait_for(RELAXED)

    def _asked(self, url: str, home: str) -> None:
        if not url.startswith((home, "data:", "blob:")):
            self.elsewhere.append(url)

    def _connected(self, connection: WebSocket) -> None:
        connection.on("framereceived", lambda frame: self.sent.append(len(frame)))

    def wait_for(self, text: str) -> None:
        expect(self.tab.locator("body")).to_contain_text(text, timeout=WAIT)

    def press(self, button: str) -> None:
        """Presses a button; without the wait for two quiet frames, which take long without a GPU."""
        self.tab.get_by_role("button", name=button, exact=True).dispatch_event("click")

    def slider(self, number: int) -> Locator:
        """A slider that can be moved: 0 is the correction of the fused curve, 1 its derotation."""
        return self.tab.get_by_role("slider").nth(number)

    def drag(self, pixels: int, number: int = 0) -> None:
        """Drags a slider by its handle, in steps as a hand does."""
        box = not_none(self.slider(number).bounding_box())
        x, y = box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0
        self.tab.mouse.move(x, y)
        self.tab.mouse.down()
        for step in range(1, 7):
            self.tab.mouse.move(x + pixels * step / 6.0, y)
            self.tab.wait_for_timeout(30)
        self.tab.mouse.up()

    def seen(self) -> bytes:
        """The drawn objects."""
        return self.tab.screenshot(timeout=WAIT)


@pytest.fixture(scope="module")
def visit(browser: Browser, page: Page) -> Visit:
    """The tab of most tests."""
    return Visit(browser, page)


def until(true: Callable[[], bool], visit: Visit) -> None:
    """Waits for what the server is to know."""
    end = time.monotonic() + WAIT / 1000.0
    while not true() and time.monotonic() < end:
        visit.tab.wait_for_timeout(50)
    assert true()


def correction(page: Page) -> int:
    assert page.session.view is not None
    return page.session.view.state[Setting("correction", APEX)]


def settled(page: Page) -> bool:
    return page.session.view is not None and page.session.view.settled and page.session.view.measures is not None


def test_a_drag_moves_the_skin_and_the_numbers(visit: Visit, page: Page) -> None:
    assert correction(page) == 0
    before, drawn = page.scene.skin.vertices.copy(), visit.seen()
    visit.sent.clear()
    visit.drag(60)
    until(lambda: correction(page) > 20 and settled(page), visit)
    visit.wait_for(RELAXED)
    assert np.linalg.norm(page.scene.skin.vertices - before, axis=1).max() > 2.0
    assert before.nbytes < sum(visit.sent)
    assert page.session.view is not None
    assert isinstance(page.session.view.surgery, PlannedSurgery)
    visit.wait_for(shown(page.session.view.surgery.curves[1].cobb_after))  # the table
    assert visit.seen() != drawn
    assert page.scene.painted is None
    assert page.scene.garment is not None
    assert all(page.scene.garment.faces[name].size for name in ("shorts", "shirt"))
    for own in (True, False):
        visit.tab.get_by_label("Own colours", exact=True).first.dispatch_event("click")
        until(lambda own=own: page.scene.skin.visible != own, visit)
        assert page.scene.painted is not None
        assert page.scene.painted.visible == own
    assert (visit.complaints, visit.elsewhere) == ([], [])


def test_every_control_has_a_name_and_words_can_be_read(visit: Visit, page: Page) -> None:
    visit.wait_for(RELAXED)
    client = visit.tab.context.new_cdp_session(visit.tab)
    nodes = client.send("Accessibility.getFullAXTree")["nodes"]
    names: dict[str, list[str]] = {}
    for node in nodes:
        names.setdefault(node.get("role", {}).get("value", ""), []).append(node.get("name", {}).get("value", ""))
    for role in ("slider", "textbox", "combobox", "button", "checkbox"):
        assert all(names[role]), (role, names[role])
    sliders = page.controls.names
    assert set(names["slider"]) <= set(sliders)
    faults = violations(visit.tab, "label", "aria-input-field-name", "button-name", "color-contrast")
    assert [fault for fault in faults if "mantine-Notification" not in fault[1]] == []


def test_two_tabs_show_one_plan_and_one_that_goes_takes_nothing_along(
    visit: Visit, page: Page, playwright: Playwright
) -> None:
    other = launch(playwright)
    second = Visit(other, page)
    share, drawn = correction(page), visit.seen()
    second.drag(30)
    second.tab.wait_for_timeout(1500)  # the last of the drag is on its way
    until(lambda: correction(page) > share and settled(page), second)
    now = correction(page)
    for tab in (visit, second):  # what one asks for is on the sliders of both
        expect(tab.slider(0)).to_have_attribute("aria-valuenow", str(now), timeout=WAIT)
    visit.tab.wait_for_timeout(300)
    assert visit.seen() != drawn
    other.close()
    visit.press("Undo")
    until(lambda: correction(page) != now and settled(page), visit)
    assert page.failure is None


def test_on_a_phone_nothing_lies_on_the_picture(browser: Browser, page: Page) -> None:
    """The picture ends where the panel begins, also after the panel is closed."""
    visit = Visit(browser, page, width=390)

    def ends() -> tuple[float, float]:
        boxes = [
            not_none(visit.tab.locator(place).first.bounding_box()) for place in ("canvas[data-engine]", PANEL)
        ]
        picture, panel = boxes
        assert (panel["x"], panel["width"]) == (0.0, 390.0)
        return picture["y"] + picture["height"], panel["y"]

    until(lambda: abs(ends()[0] - ends()[1]) < 2.0, visit)
    opened = ends()[1]
    assert 250.0 < opened < 350.0  # half of the window
    assert visit.tab.evaluate("document.documentElement.scrollWidth") <= 390
    visit.tab.locator(f'{PANEL} [style*="cursor: pointer"]').first.dispatch_event("click")
    until(lambda: ends()[1] > opened + 100.0 and abs(ends()[0] - ends()[1]) < 2.0, visit)
    visit.tab.close()
