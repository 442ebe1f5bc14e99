"""Make web-page.jpg: the page of `supersampler demo --web` in Chromium, bilinear next to `classifier`.

    pip install -e . playwright
    PYTHONPATH=tests python docs/images/browser_page.py

Chromium runs on its software adapter, so no GPU is needed; a frame takes seconds.
"""

from pathlib import Path

from supersampler.integrations.web import serving, site_files
from supersampler_export.shaders.folder import shader_files
from web_page import chromium

FRAMES = 16
ADDRESS = "index.html?test&method=classifier&size=640x360&left=bilinear&right=ours"


def main() -> None:
    """Write the image."""
    with serving(site_files(shader_files)) as url, chromium() as browser:
        page = browser.new_page(viewport={"width": 1280, "height": 950})
        page.set_default_timeout(1_200_000)
        page.goto(url + ADDRESS)
        page.wait_for_function("window.supersamplerDemo")
        page.evaluate(f"supersamplerDemo.step({FRAMES})")
        page.locator("#stage").screenshot(
            path=Path(__file__).with_name("web-page.jpg"), type="jpeg", quality=85
        )


if __name__ == "__main__":
    main()
