"""Tests of supersampling in PyVista and VTK, with OpenGL (in software will do): `make pyvista` runs them."""

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from OpenImageIO import ImageBuf

from supersampler import ArgumentError, Frame
from supersampler.frame import Array, Float32

if importlib.util.find_spec("pyvista") is None:
    pytest.skip("pyvista is not installed here", allow_module_level=True)

import pyvista as pv
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkWebCore import vtkWebApplication

from supersampler.integrations.pyvista import enable_supersampling
from supersampler.integrations.vtk import SupersampledWindow

SIZE = (240, 160)
SMALL = (120, 80)


@pytest.fixture
def plotter() -> Iterator[Any]:
    """A plotter that shows a textured floor from above, at a slant."""
    found = pv.Plotter(off_screen=True, window_size=SIZE)
    found.set_background("white")
    plane = pv.Plane(i_size=4, j_size=4, i_resolution=24, j_resolution=24)
    checks = (np.indices((24, 24)).sum(axis=0) % 2).ravel()
    found.add_mesh(plane, scalars=checks, cmap="gray", show_scalar_bar=False, lighting=False)
    found.camera_position = [(1.5, -3.0, 2.0), (0, 0, 0), (0, 0, 1)]
    found.disable_anti_aliasing()
    found.show(auto_close=False)
    yield found
    found.close()


def shown(plotter: Any) -> Float32:
    """Render once, and return what the window shows, (h, w, 3) in [0, 1]."""
    plotter.render()
    image: Float32 = np.asarray(plotter.screenshot(return_img=True)).astype(np.float32)
    return image / np.float32(255)


def stepped(window: SupersampledWindow, plotter: Any) -> Frame:
    """Render once, and return the frame that was upscaled."""
    assert window.upscaler is not None
    frames: list[Frame] = []
    step = window.upscaler.step
    window.upscaler.step = lambda frame: frames.append(frame) or step(frame)  # type: ignore[method-assign,assignment,func-returns-value]
    try:
        plotter.render()
    finally:
        window.upscaler.step = step  # type: ignore[method-assign]
    assert len(frames) == 1
    return frames[0]


def place(plotter: Any, point: tuple[float, float, float]) -> Array:
    """Return where the camera sees a point of the world, in render pixels, x right, y down."""
    plotter.renderer.SetWorldPoint(*point, 1.0)
    plotter.renderer.WorldToDisplay()
    x, y, _ = plotter.renderer.GetDisplayPoint()
    return np.array([x, SIZE[1] - y]) * (SMALL[0] / SIZE[0])


def test_a_view_at_rest_is_nearer_to_the_truth_than_without_anti_aliasing(plotter: Any) -> None:
    none = shown(plotter)
    plotter.window_size = (SIZE[0] * 8, SIZE[1] * 8)
    large = shown(plotter)
    plotter.window_size = SIZE
    truth = large.reshape(SIZE[1], 8, SIZE[0], 8, 3).mean(axis=(1, 3))
    enable_supersampling(plotter, scale=2)
    for _ in range(16):
        ours = shown(plotter)
    errors = [float(np.square(image - truth).mean()) for image in (ours, none)]
    assert errors[0] < 0.6 * errors[1]


def test_motion_of_the_camera_is_that_of_a_point_on_the_screen(plotter: Any) -> None:
    window = enable_supersampling(plotter, scale=2)
    points = [(0.0, 0.0, 0.0), (1.0, 0.7, 0.0), (-0.8, -0.4, 0.0)]
    plotter.render()
    before = [place(plotter, point) for point in points]
    plotter.camera.Azimuth(3.0)
    plotter.camera.Elevation(-1.0)
    frame = stepped(window, plotter)
    assert not frame.reset
    for point, was in zip(points, before, strict=True):
        now = place(plotter, point)
        column, row = np.floor(now).astype(int)
        np.testing.assert_allclose(frame.motion[row, column], was - now, atol=0.12)  # its centre's
    assert np.abs(was - now).max() > 0.5


def test_the_background_moves_with_the_closest_broad_surface_of_its_tile_and_rests_without(
    plotter: Any,
) -> None:
    plotter.camera.zoom(0.4)
    window = enable_supersampling(plotter, scale=2)
    plotter.render()
    plotter.camera.Azimuth(3.0)
    frame = stepped(window, plotter)
    outlines = []
    for row in range(0, SMALL[1], 16):
        for column in range(0, SMALL[0], 16):
            tile = slice(row, row + 16), slice(column, column + 16)
            depth, motion = frame.depth[tile], frame.motion[tile]
            closest = np.unravel_index(depth.argmax(), depth.shape)
            expected = motion[closest] if np.count_nonzero(depth) > 32 else np.zeros(2)
            np.testing.assert_array_equal(
                motion[depth == 0], np.broadcast_to(expected, ((depth == 0).sum(), 2))
            )
            outlines.append(depth.any() and (depth == 0).any())
    assert 4 < np.sum(outlines) < 30
    assert (np.abs(frame.motion).max(axis=-1)[frame.depth == 0] > 0.1).any()


def test_an_actor_that_moves_has_its_own_motion_and_nothing_else_has(plotter: Any) -> None:
    sphere = plotter.add_mesh(pv.Sphere(radius=0.4, center=(0, 0, 0.5)), color="red")
    window = enable_supersampling(plotter, scale=2)
    plotter.render()
    towards = np.subtract(plotter.camera.position, (0.3, 0, 0.5))
    front = np.array([0.3, 0, 0.5]) + 0.4 * towards / np.linalg.norm(towards)
    before = place(plotter, (front[0] - 0.3, front[1], front[2]))
    sphere.SetPosition(0.3, 0.0, 0.0)
    frame = stepped(window, plotter)
    now = place(plotter, (front[0], front[1], front[2]))
    column, row = np.floor(now).astype(int)
    np.testing.assert_allclose(frame.motion[row, column], before - now, atol=0.2)
    moved = (np.abs(frame.motion).max(axis=-1) > 1e-3) & (frame.depth > 0)
    assert 100 < moved.sum() < 0.3 * moved.size
    assert frame.color is not None
    reddish = frame.color[..., 0] > 1.5 * frame.color[..., 2] + 0.1
    assert (moved & reddish).sum() > 0.95 * max(moved.sum(), reddish.sum())


def test_another_view_and_another_size_start_anew(plotter: Any) -> None:
    window = enable_supersampling(plotter, scale=2)
    plotter.render()
    assert not stepped(window, plotter).reset
    plotter.camera_position = [(-3.0, 1.0, 0.4), (0, 0, 0), (0, 0, 1)]
    assert stepped(window, plotter).reset
    assert not stepped(window, plotter).reset
    window.reset()
    assert stepped(window, plotter).reset
    plotter.camera.SetParallelProjection(True)
    assert stepped(window, plotter).reset
    plotter.window_size = (200, 100)
    plotter.render()
    assert window.upscaler is not None
    assert window.upscaler.display_size == (200, 100)
    assert shown(plotter).shape == (100, 200, 3)


def test_text_is_rendered_at_full_size_on_top(plotter: Any) -> None:
    plotter.add_text("sharp", position="upper_left", font_size=10, color="black")
    none = shown(plotter)[:24, :48]
    enable_supersampling(plotter, scale=2)
    ours = shown(plotter)[:24, :48]
    assert none.min() < 0.1
    np.testing.assert_allclose(ours, none, atol=2 / 255)


@pytest.mark.parametrize("width", [1.0, 4.0])
@pytest.mark.parametrize("kind", ["line", "wireframe", "edges"])
def test_lines_are_rendered_as_wide_as_in_the_image(kind: str, width: float) -> None:
    plotter = pv.Plotter(off_screen=True, window_size=SIZE)
    plotter.set_background("white")
    if kind == "line":
        mesh = pv.Line((-1, -0.31, 0), (1, 0.27, 0))
        look: dict[str, Any] = {"color": "black"}
    else:
        mesh = pv.Plane(i_resolution=3, j_resolution=1)
        look = {"edge_color": "black", "show_edges": True, "color": "white"}
        look = {"style": "wireframe", "color": "black"} if kind == "wireframe" else look
    plotter.add_mesh(mesh, line_width=width, lighting=False, **look)
    plotter.camera_position = "xy"
    plotter.camera.Roll(12.0)
    plotter.disable_anti_aliasing()
    plotter.show(auto_close=False)
    none = shown(plotter)
    window = enable_supersampling(plotter, scale=2)
    plotter.render()
    colors = [stepped(window, plotter).color for _ in range(32)]  # of all phases of the jitter
    ink = float(np.mean([(1 - color).sum() for color in colors if color is not None]))
    assert ink * 4 / (1 - none).sum() == pytest.approx(1.0, abs=0.08)  # a render pixel is four of the image
    window.disable()
    np.testing.assert_array_equal(shown(plotter), none)
    plotter.close()


def test_each_render_is_one_frame_and_changes_nothing_of_the_plotter(plotter: Any) -> None:
    window = enable_supersampling(plotter, scale=2)
    plotter.render()
    assert window.upscaler is not None
    count = window.upscaler.stats.frames
    before = plotter.renderer.GetViewport(), plotter.camera.GetWindowCenter(), plotter.render_window.GetSize()
    for _ in range(3):
        plotter.render()
    after = plotter.renderer.GetViewport(), plotter.camera.GetWindowCenter(), plotter.render_window.GetSize()
    assert after == before
    assert window.upscaler.stats.frames == count + 3
    assert all(prop.GetVisibility() for prop in plotter.renderer.GetViewProps())


def test_the_server_side_of_trame_and_jupyter_sends_upscaled_images(plotter: Any, tmp_path: Path) -> None:
    """Both ask `vtkWebApplication`, which comes with VTK, for a JPEG of the window."""
    window = enable_supersampling(plotter, scale=2)
    for _ in range(3):
        plotter.render()
    assert window.upscaler is not None
    frames = window.upscaler.stats.frames
    server = vtkWebApplication()
    server.SetImageEncoding(0)  # bytes, not base64
    (tmp_path / "sent.jpg").write_bytes(
        vtk_to_numpy(server.StillRender(plotter.render_window, 100)).tobytes()
    )
    sent = np.asarray(ImageBuf(str(tmp_path / "sent.jpg")).get_pixels("float"))
    assert window.upscaler.stats.frames == frames + 1
    image = np.asarray(plotter.screenshot(return_img=True)).astype(np.float32) / 255
    assert np.abs(sent[..., :3] - image).mean() < 0.01
    window.disable()
    assert np.abs(sent[..., :3] - shown(plotter)).mean() > 0.01


def test_multi_sampling_that_is_turned_on_again_is_turned_off(plotter: Any) -> None:
    enable_supersampling(plotter, scale=2, model="bicubic")
    ours, other = shown(plotter), shown(plotter)  # of two jitters
    plotter.render_window.SetMultiSamples(8)
    assert np.abs(shown(plotter) - ours).mean() < 1.5 * np.abs(other - ours).mean()
    assert plotter.render_window.GetMultiSamples() == 0


def test_disabled_again_the_window_renders_as_it_did(plotter: Any) -> None:
    before = shown(plotter)
    window = enable_supersampling(plotter, scale=2)
    assert np.abs(shown(plotter) - before).max() > 0.1
    window.disable()
    np.testing.assert_array_equal(shown(plotter), before)


def test_other_things_than_an_open_plotter_of_one_view_are_refused(plotter: Any) -> None:
    with pytest.raises(ArgumentError, match="plotter is 3; want an open"):
        enable_supersampling(3)
    with pytest.raises(ArgumentError, match=r"scale is 0\.5; want a number >= 1"):
        enable_supersampling(plotter, scale=0.5)
    several = pv.Plotter(off_screen=True, shape=(1, 2))
    with pytest.raises(ArgumentError, match="plotter is 2 subplots"):
        enable_supersampling(several)
    several.close()
    with pytest.raises(ArgumentError, match="plotter is closed"):
        enable_supersampling(several)
