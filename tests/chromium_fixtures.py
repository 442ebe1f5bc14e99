"""Fixtures of the tests of the page in Chromium: a plugin of pytest."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from supersampler.integrations.web import serving, site_files, write_site
from supersampler_export.shaders.folder import shader_files
from web_page import CHROMIUM, NODE_MODULES, FolderFiles, chromium

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

KINDS = ("error", "warning")  # of messages on the console; uncaught errors of WebGPU are warnings


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("web") / "below" / "site"
    node_modules = Path(NODE_MODULES) if NODE_MODULES else None
    write_site(folder, site_files(shader_files, node_modules=node_modules))
    (folder / "blank.html").write_text('<link rel="icon" href="data:,">')  # for tests of modules alone
    return folder


@pytest.fixture(scope="module")
def url(site: Path) -> Iterator[str]:
    with serving(FolderFiles(site.parents[1])) as root:
        yield f"{root}below/site/"  # a sub-path, as file hosts have


@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed here: apt-get install chromium")
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed here")
    with chromium() as browser:
        yield browser


@pytest.fixture
def page(browser: "Browser") -> "Iterator[Page]":
    """A page that must log no error."""
    page = browser.new_page(viewport={"width": 900, "height": 720})
    page.set_default_timeout(180_000)
    errors: list[str] = []
    page.on("console", lambda message: errors.append(message.text) if message.type in KINDS else None)
    page.on("pageerror", lambda error: errors.append(str(error)))
    yield page
    page.close()
    assert not errors
