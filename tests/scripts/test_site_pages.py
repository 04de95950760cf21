"""Equations of the site."""

import pytest

pytest.importorskip("latex2mathml", reason="the dependency group docs is not installed")
import site_pages  # after the check


def test_equation_becomes_mathml() -> None:
    page = site_pages.on_page_content(r'<div class="arithmatex">\[a &lt; b^2\]</div>')
    assert page.startswith("<math")
    assert "&#x0003C;" in page  # the sign, escaped once
    assert "arithmatex" not in page


def test_equation_with_an_unknown_command_is_refused() -> None:
    with pytest.raises(ValueError, match="write it otherwise"):
        site_pages.on_page_content(r'<span class="arithmatex">\(\argh x\)</span>')
