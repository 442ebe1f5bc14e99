"""The page: images, views, controls, and what it says where it cannot run."""

import base64
import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from supersampler import Frame, Shot, Upscaler
from supersampler.frame import Float32
from supersampler.integrations.web import TYPES
from supersampler.io.display import display_transform
from supersampler.io.images import write_exr
from supersampler_export.shaders.folder import write_shader_folder
from web_page import NODE_MODULES, opened, pixels, psnr, read, screenshot

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

WITHOUT_GPU = "Object.defineProperty(navigator, 'gpu', {value: undefined})"

pytest_plugins = ["chromium_fixtures"]  # fixtures


@pytest.fixture
def any_page(browser: "Browser") -> "Iterator[Page]":
    """A page that may log errors."""
    page = browser.new_page()
    page.set_default_timeout(180_000)
    yield page
    page.close()


def choose(page: "Page", name: str, value: str) -> str:
    """Choose a value, wait, and return the note that is then shown, if any."""
    page.select_option(f"[name={name}]", value)
    return note_after(page)


def note_after(page: "Page") -> str:
    page.evaluate("supersamplerDemo.settled()")
    return page.inner_text("#note") if page.is_visible("#note") else ""


def click_single(page: "Page") -> None:
    page.click("[name=single]")
    page.evaluate("supersamplerDemo.settled()")


@pytest.mark.parametrize(
    ("method", "frames"),
    [("taa", 3), ("taau", 3), ("classifier-small", 2), ("classifier", 2), ("classifier-large", 2)],
)
def test_images_are_those_of_the_gpu_backend(page: "Page", url: str, method: str, frames: int) -> None:
    pytest.importorskip("wgpu")
    shot: Any = Shot.open("plaza")
    upscaler = Upscaler(method, display_size=shot.display_size, executor="gpu", validate="off")
    opened(page, f"{url}?test&source=shot&method={method}")
    for index in range(frames):
        if index:
            page.evaluate("supersamplerDemo.step(1)")
        frame: Any = shot.read(index).frame
        shown = display_transform(read(page, "read('ours')", shot.display_size), frame.exposure)
        expected = display_transform(upscaler.step(frame), frame.exposure)
        assert np.abs(shown - expected).mean() < 1e-3, index
        assert np.abs(shown - expected).mean() > 0.0, "read from the page, not computed here"


@pytest.mark.parametrize(("method", "gain_db"), [("taau", 2.5), ("classifier-small", 2.0)])
def test_the_live_scene_comes_close_to_its_reference(
    page: "Page", url: str, method: str, gain_db: float
) -> None:
    opened(page, f"{url}?test&size=320x180&method={method}")
    page.evaluate("supersamplerDemo.step(16)")
    state, size = page.evaluate("supersamplerDemo.state"), (320, 180)
    shape = (90, 160)
    frame = Frame(
        color=read(page, "read('input')", (160, 90)),
        depth=np.ones(shape, np.float32),
        motion=np.zeros((*shape, 2), np.float32),
        jitter=tuple(state["jitter"]),
        reset=True,
    )
    bilinear = Upscaler("bilinear", display_size=size, executor="onnx", validate="off").step(frame)
    truth = read(page, "readReference(32)", size)
    ours = psnr(read(page, "read('ours')", size), truth)
    assert ours > psnr(bilinear, truth) + gain_db


def test_the_split_shows_one_view_left_and_the_other_right(page: "Page", url: str, tmp_path: Path) -> None:
    opened(page, f"{url}?test&size=320x180&method=taau&left=input&right=ours")
    page.evaluate("supersamplerDemo.step(8)")
    page.add_style_tag(content="#split, #stage select { visibility: hidden }")
    box: Any = page.locator("#stage").bounding_box()

    def shown(at: float) -> Float32:
        page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
        page.mouse.down()
        page.mouse.move(box["x"] + at * box["width"], box["y"] + 0.5 * box["height"])
        page.mouse.up()
        page.evaluate("supersamplerDemo.settled()")
        return screenshot(page, tmp_path)

    right, both, left = shown(0.0), shown(0.5), shown(1.0)
    middle, margin = both.shape[1] // 2, 8
    np.testing.assert_array_equal(both[:, : middle - margin], left[:, : middle - margin])
    np.testing.assert_array_equal(both[:, middle + margin :], right[:, middle + margin :])
    assert np.abs(left - right).mean() > 0.005, "the views differ"
    page.locator("#split").evaluate("split => split.style.visibility = 'visible'")
    page.focus("#split")
    page.keyboard.press("ArrowLeft")
    assert page.get_attribute("#split", "aria-valuenow") == "98"


def test_method_ratio_and_size_can_be_changed_and_frames_stepped(page: "Page", url: str) -> None:
    opened(page, f"{url}?test&size=320x180&method=taau&right=truth")
    for name, value, key, wanted in (
        ("ratio", "3", "size", [107, 60]),
        ("ratio", "1.5", "size", [213, 120]),
        ("method", "taa", "method", "taa"),
        ("size", "640x360", "displaySize", [640, 360]),
        ("source", "shot", "size", [320, 180]),
    ):
        assert choose(page, name, value) == ""
        assert page.evaluate("supersamplerDemo.state")[key] == wanted
    assert not page.is_visible("[name=ratio]"), "a shot has its own"
    assert choose(page, "source", "live") == ""
    assert page.evaluate("supersamplerDemo.state.displaySize") == [640, 360]
    jitter = page.evaluate("supersamplerDemo.state.jitter")
    click_single(page)
    assert page.evaluate("supersamplerDemo.state.jitter") != jitter
    assert "upscaling" in page.inner_text("#times")


def test_an_unsupported_ratio_is_reported_and_the_next_choice_works(page: "Page", url: str) -> None:
    opened(page, f"{url}?test&size=320x180&method=classifier-large&ratio=none")
    assert "1 to 2 times less than the display" in choose(page, "ratio", "3")
    assert choose(page, "ratio", "1.5") == ""
    assert page.evaluate("supersamplerDemo.state")["size"] == [213, 120]


def test_without_webgpu_the_cpu_library_upscales(page: "Page", url: str, tmp_path: Path) -> None:
    page.add_init_script(WITHOUT_GPU)
    page.goto(f"{url}?method=taau&left=input&right=ours")
    page.wait_for_function("performance.getEntriesByName('first-image').length > 1")
    note = page.inner_text("#note")
    assert note.startswith("This browser has no WebGPU. The live scene needs WebGPU.")
    assert "the CPU library upscales the shipped shot" in note
    shown = screenshot(page, tmp_path)
    assert shown[:, :400].std() > 0.05
    assert shown[:, 400:].std() > 0.05


@pytest.mark.parametrize(("method", "mean"), [("taau", 1e-5), ("classifier", 1e-3)])
def test_webassembly_computes_the_images_of_the_cpu_backend(
    page: "Page", url: str, method: str, mean: float
) -> None:
    page.add_init_script(WITHOUT_GPU)
    page.goto(f"{url}blank.html")
    text = page.evaluate(
        """async (method) => {
            const { base64 } = await import("./page/testing.js");
            const { CpuStep } = await import("./page/cpu_step.js");
            const { ShotFolder, readerOfUrl } = await import("./page/shot_folder.js");
            const shot = await ShotFolder.open(readerOfUrl(new URL("shot/", location.href)));
            const step = await CpuStep.load(method, shot.displaySize);
            let image;
            for (let i = 0; i < 3; i++) {
                const frame = await shot.frame(i);
                image = step.step(frame, frame.exposure);
            }
            return base64(Float32Array.from(image));
        }""",
        method,
    )
    image = np.frombuffer(base64.b64decode(text), np.float32).reshape(3, 360, 640).transpose(1, 2, 0)
    upscaler = Upscaler(method, display_size=(640, 360), executor="cpu", validate="off")
    shot = Shot.open("plaza")
    for index in range(3):
        expected = upscaler.step(shot.read(index).frame)
    difference = np.abs(display_transform(image) - display_transform(expected))
    assert difference.mean() < mean
    assert np.quantile(difference, 0.999) < 4.0 / 255.0
    assert difference.max() < 20.0 / 255.0


@pytest.mark.parametrize("file", ["models/taau.js", "scene/scene.wgsl", "page/present.wgsl"])
def test_a_broken_shader_is_shown_with_the_adapter(any_page: "Page", url: str, site: Path, file: str) -> None:
    broken = re.sub(r"(fn \w+)\(", r"\1((", (site / file).read_text("utf-8"))
    kind = TYPES[Path(file).suffix]
    any_page.route(f"**/{file}", lambda route: route.fulfill(body=broken, content_type=kind))
    any_page.goto(f"{url}?method=taau")
    any_page.wait_for_function("document.getElementById('note').textContent.includes('wgsl')")
    note = any_page.inner_text("#note")
    assert "swiftshader" in note
    assert "The live scene needs WebGPU." in note, "the fallback follows"


@pytest.mark.parametrize("loss", ["destroyed", "crashed"])
def test_where_the_gpu_is_lost_the_page_goes_on_without(
    browser: "Browser", any_page: "Page", url: str, loss: str
) -> None:
    any_page.goto(f"{url}?test&size=320x180&method=taau")
    any_page.wait_for_function("window.supersamplerDemo")
    if loss == "destroyed":
        any_page.evaluate("supersamplerDemo.comparison.device.destroy()")
    else:
        browser.new_browser_cdp_session().send("Browser.crashGpuProcess")
    for place, text in (("note", "Load the page again"), ("times", "frame 2")):
        any_page.wait_for_function(f"document.getElementById('{place}').textContent.includes('{text}')")
    note = any_page.inner_text("#note")
    assert "was lost" in note
    assert "the CPU library upscales the shipped shot" in note


def test_where_memory_is_short_the_page_says_so_and_a_smaller_size_works(page: "Page", url: str) -> None:
    page.add_init_script(
        """
        const { createTexture } = GPUDevice.prototype;
        GPUDevice.prototype.createTexture = function (given) {
            if (given.size[0] === 1280) this.isShort = true;
            return createTexture.call(this, given);
        };
        const { popErrorScope, pushErrorScope } = GPUDevice.prototype, filters = [];
        GPUDevice.prototype.pushErrorScope = function (filter) {
            filters.push(filter);
            pushErrorScope.call(this, filter);
        };
        GPUDevice.prototype.popErrorScope = async function () {
            const filter = filters.pop(), error = await popErrorScope.call(this), isShort = this.isShort;
            if (filter !== "out-of-memory" || !isShort) return error;
            this.isShort = false;
            return new GPUOutOfMemoryError("allocation failed");
        };
        """
    )
    opened(page, f"{url}?test&size=320x180&method=taau")
    short = "not enough memory for this size (allocation failed). Choose a smaller one."
    assert short in choose(page, "size", "1280x720")
    assert choose(page, "size", "320x180") == ""


def test_the_times_of_the_stages_add_up(page: "Page", url: str) -> None:
    opened(page, f"{url}?test&size=320x180&method=taau")
    click_single(page)
    click_single(page)
    text = r"GPU ([\d.]+) ms: rendering ([\d.]+), upscaling ([\d.]+), showing the views ([\d.]+); a frame "
    found = re.match(text, page.inner_text("#times"))
    assert found is not None, page.inner_text("#times")
    total, *stages = map(float, found.groups())
    assert total == pytest.approx(sum(stages), abs=0.011)
    facts = "Rendered at 160x90, shown at 320x180: 25 % of the pixels are rendered."
    assert page.inner_text("#facts") == facts


def test_a_page_that_is_opened_as_a_file_asks_for_a_server(any_page: "Page", site: Path) -> None:
    any_page.goto((site / "index.html").as_uri())
    assert "from a server only" in any_page.inner_text("#note")


def test_the_code_of_the_tutorial_runs(page: "Page", url: str, site: Path) -> None:
    tutorial = Path(__file__).parents[2] / "docs/tutorials/web.md"
    code = re.findall("```js\n(.*?)```", tutorial.read_text("utf-8"), re.DOTALL)[0]
    write_shader_folder("taa", site / "models/taa")
    yours = "let calls = 0; const drawScene = () => calls++, show = () => calls++;"
    end = "draw(0); draw(1); await device.queue.onSubmittedWorkDone(); window.calls = calls;"
    (site / "tutorial.js").write_text(f"{code.replace('classifier', 'taa')}{yours}{end}")
    page.goto(f"{url}blank.html")
    page.evaluate("import('./tutorial.js')")
    assert page.evaluate("window.calls") == 4


@pytest.fixture
def three(url: str) -> str:
    """The address of the page of three.js."""
    if not NODE_MODULES:
        pytest.skip("SUPERSAMPLER_NODE_MODULES has no three")
    return f"{url}three.html"


def three_page(page: "Page", three: str, method: str = "taau") -> "Page":
    page.goto(f"{three}?test&size=320x180&method={method}")
    page.wait_for_function("window.threeDemo || !document.getElementById('note').hidden")
    assert not page.is_visible("#note"), page.inner_text("#note")
    page.evaluate("threeDemo.ready()")
    return page


def three_image(page: "Page", call: str) -> Float32:
    return pixels(page.evaluate(f"threeDemo.{call}"), (320, 180))


def is_upscaled(page: "Page") -> bool:
    return bool(page.evaluate("threeDemo.upscaled.getTextureNode().value.isStorageTexture === true"))


def test_the_node_for_three_js_is_better_than_its_own(page: "Page", three: str) -> None:
    found = {}
    for method in ("bilinear", "three-taau", "taau"):
        three_page(page, three, method)
        images = [three_image(page, "step()") for _ in range(16)]
        found[method] = images[-1]
    truth = three_image(page, "reference(32)")
    errors = {method: psnr(image, truth) for method, image in found.items()}
    assert errors["taau"] > errors["three-taau"] + 1.5, errors
    assert errors["taau"] > errors["bilinear"] + 1.5, errors


def test_the_node_follows_new_sizes_and_drops_the_history_at_a_cut(page: "Page", three: str) -> None:
    three_page(page, three)
    for _ in range(8):
        before = three_image(page, "step()")
    page.evaluate("threeDemo.renderer.toneMappingExposure = 0")  # a film that fades to black
    three_image(page, "step()")
    page.evaluate("threeDemo.renderer.toneMappingExposure = 1")
    assert page.evaluate("threeDemo.resize(256, 144)") is None
    resized = pixels(page.evaluate("threeDemo.step()"), (256, 144))
    assert abs(float(resized.mean()) - float(before.mean())) < 0.02
    page.evaluate("threeDemo.resize(320, 180)")
    again = three_image(page, "step()")
    assert psnr(again, three_image(page, "reference(32)")) > 20.0


@pytest.mark.parametrize(
    "change",
    [
        "threeDemo.upscaled.depthNode.passNode.setResolutionScale(0.7)",
        "threeDemo.resize(320, 180)",
        "Object.assign(threeDemo.pipeline, { needsUpdate: true })",
    ],
)
def test_the_first_image_after_a_change_is_upscaled(page: "Page", three: str, change: str) -> None:
    three_page(page, three)
    if "resize" in change:
        page.evaluate("threeDemo.resize(256, 144)")
    for _ in range(8):
        page.evaluate("threeDemo.step()")
    page.evaluate(f"{change} && 0")
    image = three_image(page, "step()")
    assert is_upscaled(page), "not the pass as it is"
    assert psnr(image, three_image(page, "reference(32)")) > 22.0


def with_node(page: "Page", beauty: str = "beautyNode", camera: str = "camera", output: str = "node") -> None:
    """Upscale the scene by a new node; show an expression of it."""
    page.evaluate(
        f"""async () => {{
            const {{ supersampler }} = await import("./three/node.js"), THREE = await import("three/webgpu");
            const {{ beautyNode, depthNode, velocityNode, camera }} = threeDemo.upscaled;
            const used = depthNode.passNode.camera = {camera};
            const node = supersampler({beauty}, depthNode, velocityNode, used, {{ method: "taau" }});
            Object.assign(threeDemo.pipeline, {{ outputNode: {output}, needsUpdate: true }});
            threeDemo.upscaled = node;
        }}"""
    )


def test_effects_may_lie_between_the_pass_and_the_node(page: "Page", three: str) -> None:
    images = []
    for beauty in ("beautyNode", "beautyNode.mul(1)"):
        with_node(three_page(page, three), beauty)
        page.evaluate("threeDemo.ready()")
        images.append([three_image(page, "step()") for _ in range(3)][-1])
    assert psnr(*images) > 40.0


@pytest.mark.parametrize("scale", [0.5, 0.7])
def test_depth_and_velocity_may_come_from_another_pass_of_the_same_size(
    any_page: "Page", three: str, scale: float
) -> None:
    said: list[str] = []
    any_page.on("console", lambda message: said.append(message.text))
    make = "new depthNode.passNode.constructor('color', threeDemo.scene, camera)"
    with_node(three_page(any_page, three), f"{make}.setResolutionScale({scale}).getTextureNode()")
    any_page.evaluate("threeDemo.ready()")
    for _ in range(3):
        three_image(any_page, "step()")
    assert is_upscaled(any_page) == (scale == 0.5)
    assert any("depth is 160x90; want 224x125, as beauty" in text for text in said) == (scale != 0.5)
    passes = "[threeDemo.upscaled.depthNode, threeDemo.upscaled.beautyNode].map((node) => node.passNode)"
    assert any_page.evaluate(f"{passes}.every((pass) => pass.contextNode?.value.getTextureGradient)")


def test_the_pass_can_be_shown_beside_the_node(page: "Page", three: str) -> None:
    with_node(three_page(page, three), output="node.sub(beautyNode).abs()")
    page.evaluate("threeDemo.ready()")
    assert three_image(page, "step()").mean() > 1e-3, "shown by one texture, they would not differ"


def test_the_camera_keeps_its_view_offset_and_its_aspect(page: "Page", three: str) -> None:
    three_page(page, three)
    page.evaluate("threeDemo.camera.setViewOffset(640, 360, 200, 90, 320, 180)")
    page.evaluate("threeDemo.camera.aspect = 1.6")
    for _ in range(8):
        image = three_image(page, "step()")
    view = page.evaluate("threeDemo.camera.view")
    assert [view[key] for key in ("enabled", "fullWidth", "offsetX", "width")] == [True, 640, 200, 320]
    assert page.evaluate("threeDemo.camera.aspect") == 1.6
    assert psnr(image, reference_of_own_view(page)) > 20.0


def reference_of_own_view(page: "Page") -> Float32:
    """Return the reference by the projection of the camera, in place of a view offset of `reference`."""
    page.evaluate("threeDemo.camera.setViewOffset = threeDemo.camera.clearViewOffset = () => {}")
    return three_image(page, "reference(1)")


def test_the_camera_keeps_a_projection_that_the_app_has_set(page: "Page", three: str) -> None:
    three_page(page, three)
    matrix = "threeDemo.camera.projectionMatrix"
    page.evaluate(f"{matrix}.elements[8] = 0.3")  # off axis
    page.evaluate(f"threeDemo.camera.projectionMatrixInverse.copy({matrix}).invert()")
    before = page.evaluate(f"{matrix}.toArray()")
    images = [three_image(page, "step()") for _ in range(8)]
    assert page.evaluate(f"{matrix}.toArray()") == before
    assert psnr(images[-1], reference_of_own_view(page)) > 20.0


def test_planes_that_move_from_frame_to_frame_change_no_image(page: "Page", three: str) -> None:
    images = []
    for near in (0.1, 0.13):
        three_page(page, three)
        for index in range(6):
            page.evaluate(f"threeDemo.camera.near = {near if index % 2 else 0.1}")
            page.evaluate("threeDemo.camera.updateProjectionMatrix()")
            image = three_image(page, "step()")
        images.append(image)
    assert psnr(*images) > 45.0


def test_another_camera_of_the_pass_is_followed(page: "Page", three: str) -> None:
    three_page(page, three)
    three_image(page, "step()")
    page.evaluate("void (threeDemo.camera = threeDemo.camera.clone().translateX(0.5))")
    page.evaluate("void (threeDemo.upscaled.depthNode.passNode.camera = threeDemo.camera)")
    images = [three_image(page, "step()") for _ in range(8)]
    assert page.evaluate("threeDemo.upscaled.camera === threeDemo.camera")
    assert psnr(images[-1], three_image(page, "reference(16)")) > 27.0


def test_a_pass_samples_textures_as_before_once_the_node_is_disposed(page: "Page", three: str) -> None:
    three_page(page, three)
    page.evaluate("threeDemo.step()")
    page.evaluate("window.scenePass = threeDemo.upscaled.depthNode.passNode; threeDemo.upscaled.dispose()")
    assert page.evaluate("scenePass.contextNode === null")
    own = "import('three/tsl').then(({ context }) => { scenePass.contextNode = context({ mine: 1 }); })"
    page.evaluate(own)
    with_node(page)  # as after a hot reload
    page.evaluate("threeDemo.ready()")
    images = [three_image(page, "step()") for _ in range(8)]
    assert psnr(images[-1], three_image(page, "reference(32)")) > 20.0
    assert page.evaluate("threeDemo.upscaled._uniforms.detail.value") == 0.5
    used = "scenePass._getContextNode(threeDemo.renderer).value"
    sharp = "scenePass.contextNode.value.getTextureGradient"
    assert page.evaluate(f"{used}.mine === 1 && {used}.getTextureGradient === {sharp}")
    page.evaluate("threeDemo.upscaled.dispose()")
    assert page.evaluate(f"scenePass.contextNode.value.mine === 1 && !{used}.getTextureGradient")


def test_a_displacement_map_displaces(page: "Page", three: str) -> None:
    three_page(page, three)
    page.evaluate(
        """async () => {
            const three = await import("three/webgpu");
            const displacementMap = new three.DataTexture(new Uint8Array(4).fill(255), 1, 1);
            displacementMap.needsUpdate = true;
            const material = new three.MeshStandardNodeMaterial({ displacementMap, displacementScale: 0.3 });
            const ball = new three.Mesh(new three.SphereGeometry(0.3), material);
            ball.position.set(0, 1.2, 1);
            threeDemo.scene.add(ball);
        }"""
    )
    images = [three_image(page, "step()") for _ in range(8)]
    assert psnr(images[-1], three_image(page, "reference(32)")) > 20.0


@pytest.mark.parametrize("near", [0, -50])
def test_planes_of_an_orthographic_camera_may_lie_behind_it(page: "Page", three: str, near: int) -> None:
    three_page(page, three)
    with_node(page, camera=f"new THREE.OrthographicCamera(-3, 3, 2, -2, {near}, 60)")
    page.evaluate("threeDemo.ready()")
    page.evaluate("threeDemo.step()")
    read = "threeDemo.renderer.readRenderTargetPixelsAsync(threeDemo.upscaled._inputs, 0, 0, 64, 64, 0)"
    depths = page.evaluate(f"{read}.then((values) => Array.from(values))")
    assert min(depths) >= 0.0
    assert max(depths) > 0.0


def test_a_node_that_is_disposed_while_it_loads_keeps_nothing(page: "Page", three: str) -> None:
    with_node(three_page(page, three))
    page.evaluate("threeDemo.step()")
    page.evaluate("threeDemo.upscaled.dispose()")
    page.evaluate("threeDemo.upscaled.ready")
    assert page.evaluate("threeDemo.upscaled._upscaler") is None
    with_node(page)
    page.evaluate("threeDemo.upscaled.dispose()")
    page.evaluate("threeDemo.upscaled.ready")  # of a node that was never drawn


def test_a_second_node_that_jitters_is_refused(any_page: "Page", three: str) -> None:
    said: list[str] = []
    any_page.on("console", lambda message: said.append(message.text))
    with_node(three_page(any_page, three), "threeDemo.upscaled")
    any_page.evaluate("threeDemo.step()")
    assert any("the render pipeline is jittered by another node" in text for text in said)


def test_arguments_of_the_node_that_are_something_else_are_named(any_page: "Page", three: str) -> None:
    said: list[str] = []
    three_page(any_page, three)
    any_page.on("console", lambda message: said.append(message.text))
    nodes = "const { beautyNode: a, depthNode: b, velocityNode: c } = threeDemo.upscaled;"
    for call, message in (
        ("(undefined, b, c, threeDemo.camera)", "beauty is undefined; want a node"),
        ("(a, b, undefined, threeDemo.camera)", "velocity is undefined; want a texture node"),
        ("(a, b, c)", "camera is undefined; want the camera of the pass"),
        ("(a, b.passNode, c, threeDemo.camera)", "depth is a PassNode; want a texture node"),
        ("(a, b, c, threeDemo.camera, 'taau')", 'options is "taau"; want { method }'),
        ("(a, b, c, threeDemo.camera, { Method: 1 })", 'options is {"Method":1}; want { method }'),
    ):
        script = f'import("./three/node.js").then((three) => {{ {nodes} three.supersampler{call}; }})'
        assert message in any_page.evaluate(f"{script}.catch((error) => error.message)")
    any_page.evaluate(
        'import("three/tsl").then((tsl) => { window.noVelocity = tsl.mrt({ output: tsl.output }); })'
    )
    any_page.evaluate("threeDemo.upscaled.depthNode.passNode.setMRT(noVelocity)")
    with_node(any_page)
    any_page.evaluate("threeDemo.step()")
    assert any("velocity is not rendered by the pass" in text for text in said)


@pytest.mark.parametrize(
    ("script", "query", "reason"),
    [
        (WITHOUT_GPU, "", "has no WebGPU"),
        (
            "GPUDevice.prototype.createComputePipelineAsync = async () => { throw new Error('no'); }",
            "",
            "refused by",
        ),
        ("", "&scale=0.2", "want 1 to 4 times less than the display's"),
    ],
)
def test_where_the_node_cannot_run_it_says_so_and_three_js_upscales(
    any_page: "Page", three: str, script: str, query: str, reason: str
) -> None:
    said: list[str] = []
    any_page.add_init_script(script)
    any_page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
    with any_page.expect_console_message(lambda message: message.text.startswith("supersampler:")):
        any_page.goto(f"{three}?size=320x180&method=taau{query}")
    any_page.wait_for_timeout(1000)
    assert not any_page.is_visible("#note"), any_page.inner_text("#note")
    [mine] = [text for text in said if text.startswith("supersampler:")]
    assert reason in mine
    assert mine.endswith("The image is upscaled by three.js' own TAAU node instead.")


# --- shots of the user's own on the page, and its reader of EXR files ---


CHANNELS = ["R", "G", "B", "motion.X", "motion.Y", "depth.Z"]


def small_shot(folder: Path, channels: Sequence[str] = CHANNELS) -> Path:
    """Write a shot of two frames, 32x18."""
    planes = np.random.default_rng(0).random((18, 32, len(channels))).astype(np.float32)
    for index in range(2):
        write_exr(folder / f"frames/{index}.exr", planes, channels)
    frames = [
        {"file": f"frames/{index}.exr", "jitter": [0.1, -0.2], "reset": index == 0} for index in range(2)
    ]
    sizes = {"render_size": [32, 18], "display_size": [64, 36]}
    (folder / "shot.json").write_text(json.dumps({"version": 1, "name": "mine", **sizes, "frames": frames}))
    return folder


def test_a_chosen_shot_is_shown(page: "Page", url: str, tmp_path: Path) -> None:
    opened(page, f"{url}?test&size=320x180&method=taa")
    page.set_input_files("[name=folder]", small_shot(tmp_path / "mine"))
    page.wait_for_function("supersamplerDemo.state.displaySize[0] === 64")
    assert page.locator("[name=source] option[value=own]").inner_text() == "shot mine"
    assert not page.is_visible("#note")


def test_a_dropped_folder_is_read(page: "Page", url: str, tmp_path: Path) -> None:
    opened(page, f"{url}?test&size=320x180&method=taa")
    folder = small_shot(tmp_path / "mine", CHANNELS[:-1])
    session = page.context.new_cdp_session(page)
    for kind in ("dragEnter", "dragOver", "drop"):
        data = {"items": [], "files": [str(folder)], "dragOperationsMask": 1}
        session.send("Input.dispatchDragEvent", {"type": kind, "x": 200, "y": 300, "data": data})
    page.wait_for_selector("#note:visible")
    said = "frames/0.exr has no channel depth.Z; it has B, G, R, motion.X, motion.Y."
    assert page.inner_text("#note") == said
