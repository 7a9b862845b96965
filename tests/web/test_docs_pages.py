"""The documentation in Chromium, at the widths of a phone and a screen, light and dark: nothing is wider than the page.

``make docs`` builds the pages; OCISAC_DOCS is their folder.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

SITE = os.environ.get("OCISAC_DOCS")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(SITE is None or CHROMIUM is None, reason="make web builds the pages and runs these")

# Elements that reach beyond the page and are not within one that scrolls.
WIDER = """() => [...document.querySelectorAll('article *')].filter(one => {
  const box = one.getBoundingClientRect();
  if (box.width === 0 || box.right <= innerWidth + 1) return false;
  for (let up = one; up !== document.body; up = up.parentElement)
    if (['auto', 'scroll', 'hidden'].includes(getComputedStyle(up).overflowX)) return false;
  return true;
}).map(one => one.tagName + ' ' + (one.textContent || one.src || '').slice(0, 60))"""


def pages() -> list[Path]:
    return [] if SITE is None else sorted(path for path in Path(SITE).rglob("*.html") if "_modules" not in path.parts)


@pytest.fixture(scope="module")
def browser():
    with pytest.importorskip("playwright.sync_api").sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        yield started
        started.close()


@pytest.mark.parametrize("width", [390, 1440])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_wider_than_the_page(browser, width, scheme):
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
    page = context.new_page()
    wider = {}
    for path in pages():
        page.goto(path.as_uri())
        scrolls = page.evaluate("document.documentElement.scrollWidth > innerWidth")
        found = page.evaluate(WIDER)
        if scrolls or found:
            wider[str(path.relative_to(str(SITE)))] = found[:3]
    context.close()
    assert len(pages()) > 40
    assert not wider


def test_options_keep_their_two_minus_signs(browser):
    page = browser.new_page()
    for path in pages():
        page.goto(path.as_uri())
        text = page.inner_text("article") if page.query_selector("article") else ""
        assert " –json" not in text, path
        assert "–no-" not in text, path
    page.goto((Path(str(SITE)) / "start/install.html").as_uri())
    assert page.query_selector("button.copybtn")


@pytest.mark.skipif(SITE is None, reason="make web builds the pages")
def test_the_search_has_no_computation_times():
    assert "Computation times" not in (Path(str(SITE)) / "searchindex.js").read_text(encoding="utf-8")
