"""Pages for every reader: names and contrasts by axe-core, numbers as cards on a phone, the same place twice."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (uv sync installs it)")
from playwright.sync_api import Browser, Page, expect, sync_playwright

from support.axe import violations
from support.chromium import CHROMIUM, WEBGL, needs_chromium
from support.known_patient import PLAN, known_intervals, write_known_result
from warp_trunk.bone_motion.plan import plan_text
from warp_trunk.report.writing import write_comparison, write_report
from warp_trunk.results import read_result

pytestmark = [needs_chromium, pytest.mark.slow]
PHONE, DESKTOP = 390, 1280


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(WEBGL))
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A report with intervals and a plan, and the same result twice side by side."""
    folder = tmp_path_factory.mktemp("reading")
    results = []
    for name in ("a", "b"):
        text = plan_text(replace(PLAN, liv=f"L{1 + len(results)}"))
        results.append(read_result(write_known_result(folder / name, intervals=known_intervals(), plan_text=text)))
    return {"report": write_report(results[0]), "plans": write_comparison(results, folder / "plans")}


def opened(browser: Browser, page: Path, width: int) -> Page:
    tab = browser.new_context(offline=True, viewport={"width": width, "height": 900}).new_page()
    tab.goto(page.resolve().as_uri())
    return tab


@pytest.mark.parametrize("name", ["report", "plans"])
def test_a_page_asks_for_nothing_and_complains_of_nothing_on_screens_and_paper(
    browser: Browser, pages: dict[str, Path], name: str
) -> None:
    complaints, requests = list[str](), set[str]()
    tab, address = browser.new_context(offline=True).new_page(), pages[name].resolve().as_uri()
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.on("console", lambda said: complaints.extend([said.text] * (said.type in ("error", "warning"))))
    tab.on("request", lambda request: requests.add(request.url))
    for width in (DESKTOP, PHONE):
        tab.set_viewport_size({"width": width, "height": 900})
        tab.goto(address, wait_until="load")
        assert tab.evaluate("document.documentElement.scrollWidth") <= width
    sizes = tab.evaluate("[...document.images].map(image => image.complete && image.naturalWidth)")
    assert min(sizes) > 100
    assert {url for url in requests if not url.startswith("data:")} == {address}
    assert [said for said in complaints if "GL Driver Message" not in said] == []
    printed = tab.pdf(prefer_css_page_size=True)
    assert 2 <= printed.count(b"/Type /Page") - printed.count(b"/Type /Pages") <= 10
    assert b"[0 0 595" in printed or b"[0 0 594.9" in printed  # A4


@pytest.mark.parametrize("width", [DESKTOP, PHONE])
@pytest.mark.parametrize("name", ["report", "plans"])
def test_axe_finds_no_fault(browser: Browser, pages: dict[str, Path], name: str, width: int) -> None:
    tab = opened(browser, pages[name], width)
    tab.wait_for_selector("#turning[data-ready]")
    tab.get_by_label("Colour of the hump").check()  # its legend, too
    assert violations(tab) == []


@pytest.mark.parametrize("name", ["report", "plans"])
def test_a_phone_shows_every_number_with_its_label_within_the_window(
    browser: Browser, pages: dict[str, Path], name: str
) -> None:
    tab = opened(browser, pages[name], PHONE)
    cells = tab.evaluate(
        """() => [...document.querySelectorAll('td')].map(cell => {
          const box = cell.getBoundingClientRect(), label = getComputedStyle(cell, '::before').content;
          return [label, box.left, box.right, cell.textContent];
        })"""
    )
    assert len(cells) > 20
    for label, left, right, text in cells:
        assert label.strip('"') not in ("", "none"), text
        assert left >= 0.0
        assert right <= PHONE
    for picture in tab.locator("img").all():  # no plan is off the screen
        box = picture.bounding_box()
        assert box is not None
        assert box["x"] >= 0.0
        assert box["x"] + box["width"] <= PHONE


def test_a_legend_says_what_the_shirt_hides(browser: Browser, pages: dict[str, Path]) -> None:
    tab = opened(browser, pages["report"], DESKTOP)
    tab.wait_for_selector("#turning[data-ready]")
    key, hides = tab.locator("[data-part=key]"), tab.locator("[data-part=hides]")
    assert not key.is_visible()
    tab.get_by_label("Colour of the hump").check()
    key.wait_for()
    assert "by more than 40 mm" in key.inner_text()
    assert hides.inner_text() == ""
    tab.get_by_label("In a close shirt").check()
    expect(hides).to_have_text("The close shirt hides these colours.")


def test_what_is_compared_is_the_same_place(browser: Browser, pages: dict[str, Path]) -> None:
    """Equal skins: every tile names the place of before surgery, and no plan differs from the other."""
    words = opened(browser, pages["plans"], DESKTOP).inner_text("body")
    assert "The predicted skins of plan A and plan B are up to 0.0 mm apart" in words
    rows = opened(browser, pages["plans"], DESKTOP).locator("table[aria-label='Differences between plans'] td")
    assert {text.split(" ")[0] for text in rows.all_inner_texts()} == {"alike"}
    report = opened(browser, pages["report"], DESKTOP)
    levels = {row.split("\t")[0] for row in report.locator("table").all_inner_texts() for row in row.split("\n")}
    tiles = report.locator(".glance li").all_inner_texts()
    for tile in tiles:
        if "rotation of the back at " in tile:
            level = tile.partition("rotation of the back at ")[2].split(",")[0].split("\n")[0]
            assert level in levels
    assert any("hump at T" in tile for tile in tiles)
