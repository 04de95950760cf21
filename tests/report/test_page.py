"""The report as a reader sees it: opened in Chromium."""

import pytest

pytest.importorskip("playwright", reason="playwright is not installed (uv sync installs it)")

from support.chromium import needs_chromium, open_page

pytestmark = [needs_chromium, pytest.mark.slow]


@pytest.fixture(scope="module")
def opened(plain_report):
    return plain_report, open_page(plain_report)


def test_nothing_complains_and_nothing_is_asked_for(opened):
    page, seen = opened
    assert seen.complaints == []
    assert set(seen.requests) == {page.resolve().as_uri()}


def test_every_picture_is_drawn(opened):
    _, seen = opened
    assert len(seen.pictures) == 10
    for picture in seen.pictures:
        assert picture["complete"]
        assert min(picture["width"], picture["height"], picture["shown"]) > 100
        assert picture["colours"] > 20


def test_page_is_as_wide_as_the_window_and_has_its_words(opened):
    _, seen = opened
    assert max(seen.overflow.values()) <= 0
    assert "A research simulation" in seen.words
    assert "Rotation of the back at every vertebra" in seen.words


def test_page_prints_on_a_few_sheets_of_a4(opened):
    printed = opened[1].printed
    assert printed.startswith(b"%PDF")
    sheets = printed.count(b"/Type /Page") - printed.count(b"/Type /Pages")
    assert 2 <= sheets <= 8
    assert b"[0 0 595.9" in printed or b"[0 0 595.2" in printed or b"[0 0 594.9" in printed
