"""Make web-page.jpg: the page of `supersampler demo --web` in Chromium, bilinear next to `classifier`.

    pip install -e . playwright
    python docs/images/web_page.py [path of Chromium]

Chromium runs on its software adapter, so no GPU is needed; a frame takes seconds.
"""

import shutil
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

from supersampler.integrations.web import serving, site_files
from supersampler_export.shaders.folder import shader_files

FRAMES = 16
ADDRESS = "index.html?test&method=classifier&size=640x360&left=bilinear&right=ours"
SOFTWARE = (
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
    "--use-vulkan=swiftshader",
    "--use-angle=swiftshader",
    "--enable-features=Vulkan,WebGPU",
    "--no-sandbox",
)


def main() -> None:
    """Write the image."""
    chromium = sys.argv[1] if len(sys.argv) > 1 else shutil.which("chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=[*SOFTWARE])
        page = browser.new_page(viewport={"width": 1280, "height": 950})
        page.set_default_timeout(1_200_000)
        with serving(site_files(shader_files)) as url:
            page.goto(url + ADDRESS)
            page.wait_for_function("window.supersamplerDemo")
            page.evaluate(f"supersamplerDemo.step({FRAMES})")
            page.locator("#stage").screenshot(
                path=Path(__file__).with_name("web-page.jpg"), type="jpeg", quality=85
            )
        browser.close()


if __name__ == "__main__":
    main()
