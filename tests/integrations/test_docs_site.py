"""The site of the documentation, opened from disk in Chromium: its search finds pages. After `make docs`."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytest_plugins = ["chromium_fixtures"]  # fixtures
SITE = Path(__file__).parents[2] / "out/site"


@pytest.mark.skipif(not (SITE / "index.html").exists(), reason="make docs builds the site")
def test_the_site_is_searched_from_disk(page: "Page") -> None:
    page.goto(f"{(SITE / 'index.html').as_uri()}?q=jitter")
    found = page.locator(".md-search-result__link")
    found.first.wait_for(state="attached")
    assert found.count() > 3
    assert (found.first.get_attribute("href") or "").startswith(SITE.as_uri())
