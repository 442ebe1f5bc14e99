"""Tests of supersampling in PyVista and VTK, with OpenGL (software is enough): `make pyvista` runs them."""

import asyncio
import importlib.util
import re
import runpy
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
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
from vtkmodules.vtkCommonCore import vtkInformation
from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction, vtkPlane
from vtkmodules.vtkCommonMath import vtkMatrix4x4
from vtkmodules.vtkCommonTransforms import vtkTransform
from vtkmodules.vtkRenderingAnnotation import vtkAxesActor, vtkAxisActor
from vtkmodules.vtkRenderingCore import (
    vtkActor,
    vtkAssembly,
    vtkBillboardTextActor3D,
    vtkDataSetMapper,
    vtkFollower,
    vtkGlyph3DMapper,
    vtkHardwareSelector,
    vtkLight,
    vtkLODProp3D,
    vtkPolyDataMapper,
    vtkProp,
    vtkProp3DFollower,
    vtkPropAssembly,
    vtkProperty,
    vtkRenderer,
    vtkRenderWindow,
    vtkVolume,
)
from vtkmodules.vtkRenderingOpenGL2 import vtkOpenGLSkybox
from vtkmodules.vtkRenderingVolume import vtkGPUVolumeRayCastMapper, vtkMultiVolume
from vtkmodules.vtkWebCore import vtkWebApplication

from supersampler.integrations.pyvista import enable_supersampling
from supersampler.integrations.vtk import Pace, SupersampledWindow
from supersampler.integrations.vtk_pixels import Rectangle, WindowPixels, upsampled_depth

SIZE = (240, 160)
SMALL = (120, 80)
XVFB = shutil.which("xvfb-run")
SERVER = (
    vtkWebApplication()
)  # outlives each window: its observer of a window refers to it even when it is gone
GALLERY = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "pyvista_gallery.py"))["SCENES"]


@pytest.fixture
def plotter() -> Iterator[Any]:
    """A plotter that shows a textured floor from above, at a slant."""
    found = pv.Plotter(off_screen=True, window_size=SIZE)
    found.set_background("white")
    plane = pv.Plane(i_size=4, j_size=4, i_resolution=24, j_resolution=24)
    checks = (np.indices((24, 24)).sum(axis=0) % 2).ravel()
    found.add_mesh(plane, scalars=checks, cmap="gray", show_scalar_bar=False, lighting=False, name="floor")
    found.camera_position = [(1.5, -3.0, 2.0), (0, 0, 0), (0, 0, 1)]
    found.show(auto_close=False)
    yield found
    found.close()


def supersampled(plotter: Any, **options: Any) -> SupersampledWindow:
    """Turn supersampling on, at any cost."""
    return enable_supersampling(plotter, **{"scale": 2, "force": True, **options})


def seen(plotter: Any) -> Float32:
    """Return what the window shows, (h, w, 3) in [0, 1], without rendering."""
    size = plotter.render_window.GetActualSize()
    pixels = WindowPixels(plotter.render_window).read_color(Rectangle(0, 0, *size))[..., :3]
    return pixels.astype(np.float32) / np.float32(255)


def shown(plotter: Any) -> Float32:
    """Render once, and return what the window shows."""
    plotter.render()
    return seen(plotter)


def plain(plotter: Any) -> Float32:
    """Return what PyVista shows with its multi-sampling."""
    plotter.render_window.SetMultiSamples(4)
    return shown(plotter)


def without(window: SupersampledWindow, plotter: Any) -> Float32:
    """Return what PyVista shows once supersampling is off."""
    window.disable()
    return plain(plotter)


def truth(plotter: Any) -> Float32:
    """Return the view without supersampling, with 64 samples a pixel."""
    plotter.render_window.SetMultiSamples(0)
    total = np.zeros((SIZE[1], SIZE[0], 3), np.float32)
    for index in range(64):
        x, y = index % 8 / 8 - 0.4375, index // 8 / 8 - 0.4375
        plotter.camera.SetWindowCenter(2 * x / SIZE[0], 2 * y / SIZE[1])
        total += shown(plotter)
    plotter.camera.SetWindowCenter(0, 0)
    return total / np.float32(64)


def turn(plotter: Any, angle: float = 3.0) -> None:
    """Turn the camera, without rendering."""
    plotter.camera.Azimuth(angle)
    plotter.renderer.ResetCameraClippingRange()


def moving(plotter: Any) -> None:
    """Render some frames that move, with the history that they need."""
    for _ in range(4):
        turn(plotter, 0.5)
        plotter.render()


def in_turn(window: SupersampledWindow, plotter: Any) -> tuple[Float32, Float32, Float32]:
    """Return what shows while the view moves, at rest, and without supersampling."""
    moving(plotter)
    ours = seen(plotter)
    window.converge()
    return ours, seen(plotter), without(window, plotter)


def stepped(window: SupersampledWindow, plotter: Any, viewport: int = 0) -> Frame:
    """Render once, and return the frame that was upscaled."""
    history = window.viewports[viewport]
    frames: list[Frame] = []
    upscale = history.upscale
    history.upscale = lambda frame: frames.append(frame) or upscale(frame)  # type: ignore[method-assign,func-returns-value]
    try:
        plotter.render()
    finally:
        history.upscale = upscale  # type: ignore[method-assign]
    assert len(frames) == 1
    return frames[0]


def place(plotter: Any, point: tuple[float, float, float]) -> Array:
    """Return where the camera sees a point of the world, in render pixels, x right, y down."""
    plotter.renderer.SetWorldPoint(*point, 1.0)
    plotter.renderer.WorldToDisplay()
    x, y, _ = plotter.renderer.GetDisplayPoint()
    return np.array([x, SIZE[1] - y]) * (SMALL[0] / SIZE[0])


def error(image: Float32, reference: Float32) -> float:
    return float(np.square(image - reference).mean())


def test_the_first_image_and_the_first_after_movement_are_those_of_plain_pyvista(plotter: Any) -> None:
    plotter.add_text("sharp", position="upper_left", font_size=10, color="black")
    before = plain(plotter)
    window = supersampled(plotter)
    np.testing.assert_array_equal(shown(plotter), before)
    moving(plotter)
    np.testing.assert_array_equal(shown(plotter), without(window, plotter))


def test_a_view_at_rest_converges_to_the_truth_as_screenshots_show(plotter: Any) -> None:
    plotter.add_mesh(pv.Line((-1, -1, 0.5), (1, 1, 0.5)), color="red")
    reference, multi_sampled = truth(plotter), plain(plotter)
    window = supersampled(plotter)
    plotter.render()
    assert not window.is_converged
    errors = [error(seen(plotter), reference)]
    while not window.is_converged:
        errors.append(error(shown(plotter), reference))
    assert len(errors) <= 20
    assert errors[-1] < 0.3 * error(multi_sampled, reference)
    assert max(errors) < 1.3 * errors[0]  # no render at rest is worse than the plain one, by eye
    converged = np.rint(255 * seen(plotter))
    np.testing.assert_array_equal(plotter.screenshot(return_img=True), converged)


def test_a_view_that_moves_is_nearer_to_the_truth_than_without_anti_aliasing(plotter: Any) -> None:
    window = supersampled(plotter)
    plotter.render()
    for _ in range(16):
        turn(plotter, 0.5)
        plotter.render()
    ours = seen(plotter)
    window.disable()
    plotter.render_window.SetMultiSamples(0)
    none = shown(plotter)
    reference = truth(plotter)
    assert error(ours, reference) < 0.7 * error(none, reference)


def test_motion_of_the_camera_is_that_of_a_point_on_the_screen(plotter: Any) -> None:
    window = supersampled(plotter)
    points = [(0.0, 0.0, 0.0), (1.0, 0.7, 0.0), (-0.8, -0.4, 0.0)]
    plotter.render()
    moving(plotter)
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
    window = supersampled(plotter)
    plotter.render()
    moving(plotter)
    turn(plotter)
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
    window = supersampled(plotter)
    moving(plotter)
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


def test_a_jump_and_another_size_show_a_plain_image(plotter: Any) -> None:
    window = supersampled(plotter)
    plotter.render()
    moving(plotter)
    plotter.camera.position = (-3.0, 1.0, 0.4)
    jumped = shown(plotter)
    turn(plotter, 1.0)
    assert stepped(window, plotter).reset
    moving(plotter)
    plotter.render_window.SetSize(200, 100)
    resized = shown(plotter)
    window.disable()
    np.testing.assert_array_equal(resized, plain(plotter))
    plotter.render_window.SetSize(*SIZE)
    turn(plotter, -3.0)
    np.testing.assert_array_equal(jumped, plain(plotter))


def change_points(plotter: Any) -> None:
    plotter.meshes[0].points[:, 2] += 0.3 * np.sin(3 * plotter.meshes[0].points[:, 0])


def change_scalars(plotter: Any) -> None:
    plotter.meshes[0].cell_data.active_scalars[:] = 1 - plotter.meshes[0].cell_data.active_scalars


CHANGES: dict[str, Callable[[Any], Any]] = {
    "points": change_points,
    "scalars": change_scalars,
    "colours": lambda plotter: setattr(plotter.mapper.lookup_table, "cmap", "viridis"),
    "opacity": lambda plotter: plotter.actors["floor"].GetProperty().SetOpacity(0.3),
    "visibility": lambda plotter: plotter.actors["floor"].VisibilityOff(),
    "light": lambda plotter: plotter.renderer.lights[0].SetIntensity(0.2),
    "a light": lambda plotter: plotter.renderer.AddLight(vtkLight()),
    "background": lambda plotter: plotter.renderer.SetBackground(0.2, 0.4, 0.2),
    "a mesh": lambda plotter: plotter.add_mesh(pv.Sphere(radius=0.4), color="red", render=False),
    "a surface that gets edges": lambda plotter: plotter.actors["floor"].GetProperty().EdgeVisibilityOn(),
    "a forced pass": lambda plotter: plotter.actors["floor"].ForceTranslucentOn(),
    "a gradient": lambda plotter: plotter.renderer.GradientBackgroundOn(),
    "sides with light": lambda plotter: plotter.renderer.TwoSidedLightingOff(),
}


def image_of(values: Any) -> Any:
    """An image of VTK with these RGB bytes in 4x4 pixels."""
    image = pv.ImageData(dimensions=(4, 4, 1))
    image.point_data.active_scalars_name = None
    image["rgb"] = np.tile(np.array(values, np.uint8), (16, 1))
    return image


def textured(plotter: Any) -> Callable[[], None]:
    texture = pv.Texture(image_of((200, 20, 20)))
    plotter.add_mesh(pv.Plane(center=(0, 0, 0.3)), texture=texture, lighting=False)

    def change() -> None:
        image = texture.GetInput()
        image.GetPointData().GetScalars().Fill(40)
        image.Modified()

    return change


def clipped(plotter: Any) -> Callable[[], None]:
    plane = vtkPlane()
    actor = plotter.add_mesh(pv.Sphere(radius=0.6, center=(0, 0, 0.6)), color="red")
    actor.mapper.AddClippingPlane(plane)
    return lambda: plane.SetOrigin(0.4, 0.0, 0.0)


def glyphs(plotter: Any) -> Callable[[], None]:
    mapper, source = vtkGlyph3DMapper(), pv.Sphere(radius=0.2)
    mapper.SetInputData(pv.PolyData(np.array([(0, 0, 0.5), (1, 0, 0.5)], np.float32)))
    mapper.SetSourceData(source)
    actor = vtkActor()
    actor.SetMapper(mapper)
    plotter.renderer.AddActor(actor)

    def change() -> None:
        source.points *= 2.0
        source.Modified()

    return change


def assembled(plotter: Any) -> Callable[[], None]:
    mesh, assembly = pv.Cube(center=(0, 0, 0.6), x_length=0.5), vtkAssembly()
    assembly.AddPart(pv.Actor(mapper=pv.DataSetMapper(mesh)))
    plotter.renderer.AddActor(assembly)

    def change() -> None:
        mesh.points[:, 2] *= 1.5
        mesh.Modified()

    return change


def followed(plotter: Any) -> Callable[[], None]:
    follower = vtkFollower()
    follower.SetMapper(pv.DataSetMapper(pv.Disc(inner=0.0, outer=0.5)))
    follower.SetCamera(plotter.camera)
    follower.SetPosition(0.0, 0.0, 0.5)
    plotter.renderer.AddActor(follower)
    return lambda: follower.SetPosition(0.5, 0.5, 0.5)


def written(plotter: Any) -> Callable[[], None]:
    text = vtkBillboardTextActor3D()
    text.SetInput("text")
    text.SetPosition(0.0, 0.0, 0.5)
    plotter.renderer.AddActor(text)
    return lambda: text.GetTextProperty().SetColor(1.0, 0.0, 0.0)


def lit(plotter: Any) -> Callable[[], None]:
    light, matrix = vtkLight(), vtkMatrix4x4()
    light.SetLightTypeToSceneLight()
    light.SetPosition(3.0, 0.0, 3.0)
    light.SetTransformMatrix(matrix)
    plotter.renderer.AddLight(light)
    plotter.add_mesh(pv.Sphere(radius=0.6, center=(0, 0, 0.6)))

    def change() -> None:
        matrix.SetElement(0, 3, -6.0)
        light.SetTransformMatrix(matrix)

    return change


def measured(plotter: Any) -> Callable[[], None]:
    axes = plotter.show_grid(bounds=(-1, 1, -1, 1, 0, 1), color="black")
    return lambda: axes.SetBounds(-1, 1, -1, 1, 0, 0.5)


def backed(plotter: Any) -> Callable[[], None]:
    plotter.renderer.SetBackgroundTexture(pv.Texture(image_of((20, 200, 20))))
    return lambda: plotter.renderer.TexturedBackgroundOn()


def shifted(plotter: Any) -> Callable[[], None]:
    pixels = np.zeros((8, 8, 3), np.uint8)
    pixels[:, :4] = 255
    texture, transform = pv.Texture(pixels), vtkTransform()
    texture.SetTransform(transform)
    plotter.add_mesh(pv.Plane(center=(0, 0, 0.3)), texture=texture, lighting=False)
    return lambda: transform.Translate(0.3, 0.0, 0.0)


def keyed(plotter: Any) -> Callable[[], None]:
    pixels = np.zeros((8, 8, 3), np.uint8)
    pixels[:, :4] = 255
    actor = plotter.add_mesh(pv.Plane(center=(0, 0, 0.3)), texture=pv.Texture(pixels), lighting=False)
    keys = vtkInformation()
    actor.SetPropertyKeys(keys)

    def change() -> None:
        matrix = np.eye(4)
        matrix[0, 3] = 0.3
        for value in matrix.ravel().tolist():
            keys.Append(vtkProp.GENERAL_TEXTURE_TRANSFORM(), value)

    return change


def in_detail(plotter: Any) -> Callable[[], None]:
    look, mapper, prop = vtkProperty(), vtkPolyDataMapper(), vtkLODProp3D()
    mapper.SetInputData(pv.Sphere(radius=0.5, center=(0, 0, 0.5)))
    prop.AddLOD(mapper, look, 0.0)
    plotter.renderer.AddActor(prop)
    return lambda: look.SetColor(1.0, 0.0, 0.0)


def several_volumes(plotter: Any) -> Callable[[], None]:
    mapper, whole, volumes = vtkGPUVolumeRayCastMapper(), vtkMultiVolume(), [vtkVolume(), vtkVolume()]
    whole.SetMapper(mapper)
    for index, volume in enumerate(volumes):
        grid = pv.ImageData(dimensions=(8, 8, 8), spacing=(0.1, 0.1, 0.1), origin=(index - 1.0, 0.0, 0.2))
        grid["density"] = np.full(grid.n_points, 200, np.uint8)
        opacity = vtkPiecewiseFunction()
        opacity.AddPoint(0.0, 0.1)
        volume.GetProperty().SetScalarOpacity(opacity)
        mapper.SetInputDataObject(index, grid)
        whole.SetVolume(volume, index)
    plotter.renderer.AddVolume(whole)
    return lambda: volumes[0].SetPosition(0.3, 0.0, 0.0)


def coloured_axis(plotter: Any) -> Callable[[], None]:
    axes = plotter.show_grid(bounds=(-1, 1, -1, 1, 0, 1), color="black")
    return lambda: axes.GetYAxesGridlinesProperty().SetColor(1.0, 0.0, 0.0)


def captioned(plotter: Any) -> Callable[[], None]:
    axes = vtkAxesActor()
    axes.SetTotalLength(2.0, 2.0, 2.0)
    plotter.renderer.AddActor(axes)
    return lambda: axes.GetXAxisCaptionActor2D().GetCaptionTextProperty().SetColor(1.0, 0.0, 0.0)


def reaching(plotter: Any) -> Callable[[], None]:
    axis = vtkAxisActor()
    axis.SetPoint1(-1.0, -1.0, 0.5)
    axis.SetPoint2(-0.5, -1.0, 0.5)
    axis.SetBounds(-1.0, 1.0, -1.0, -1.0, 0.5, 0.5)
    axis.SetCamera(plotter.camera)
    axis.GetAxisLinesProperty().SetLineWidth(8)
    plotter.renderer.AddActor(axis)
    return lambda: axis.SetPoint2(1.0, -1.0, 0.5)


def facing(plotter: Any) -> Callable[[], None]:
    follower, disc = vtkProp3DFollower(), vtkActor()
    disc.SetMapper(pv.DataSetMapper(pv.Disc(inner=0.0, outer=0.5)))
    follower.SetProp3D(disc)
    follower.SetCamera(plotter.camera)
    plotter.renderer.AddActor(follower)
    return lambda: disc.GetProperty().SetColor(1.0, 0.0, 0.0)


def tinted(plotter: Any) -> Callable[[], None]:
    shaders = plotter.actors["floor"].GetShaderProperty()
    light = "//VTK::Light::Impl"
    shaders.AddFragmentShaderReplacement(light, True, light + "\nfragOutput0.rgb *= tint;\n", False)
    uniforms = shaders.GetFragmentCustomUniforms()
    uniforms.SetUniformf("tint", 1.0)
    return lambda: uniforms.SetUniformf("tint", 0.5)


def masked(plotter: Any) -> Callable[[], None]:
    grid = pv.ImageData(dimensions=(8, 8, 8), spacing=(0.1, 0.1, 0.1), origin=(0.0, 0.0, 0.2))
    mask = grid.copy()
    grid["density"] = np.full(grid.n_points, 200, np.uint8)
    mask["inside"] = np.full(grid.n_points, 255, np.uint8)
    mapper = plotter.add_volume(grid, opacity=0.5, mapper="gpu", show_scalar_bar=False).mapper
    mapper.SetMaskInput(mask)
    mapper.SetMaskTypeToBinary()

    def change() -> None:
        mask["inside"][256:] = 0
        mask.Modified()

    return change


PREPARED: dict[str, Callable[[Any], Callable[[], None]]] = {
    "pixels of a texture": textured,
    "a clipping plane": clipped,
    "the shape of glyphs": glyphs,
    "points in an assembly": assembled,
    "the place of a follower": followed,
    "the colour of a text": written,
    "the matrix of a light": lit,
    "a background image": backed,
    "the bounds of a grid": measured,
    "the transform of a texture": shifted,
    "the texture coordinates of an actor": keyed,
    "the colour of a level of detail": in_detail,
    "the place of one of several volumes": several_volumes,
    "the colour of a grid's lines": coloured_axis,
    "the colour of a caption of axes": captioned,
    "the end of an axis": reaching,
    "the colour of what follows the camera": facing,
    "a uniform of a shader": tinted,
    "the mask of a volume": masked,
}


@pytest.mark.parametrize("prepare", PREPARED.values(), ids=PREPARED.keys())
def test_changes_behind_a_prop_show_at_once(
    plotter: Any, prepare: Callable[[Any], Callable[[], None]]
) -> None:
    change = prepare(plotter)
    window = supersampled(plotter)
    window.converge()
    before = seen(plotter)
    change()
    ours = shown(plotter)
    expected = without(window, plotter)
    assert np.abs(before - expected).mean() > 0.002
    np.testing.assert_array_equal(ours, expected)


@pytest.mark.parametrize("while_moving", [False, True], ids=["at rest", "moving"])
@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_changes_of_the_scene_show_at_once(
    plotter: Any, change: Callable[[Any], Any], while_moving: bool
) -> None:
    plotter.actors["floor"].GetProperty().LightingOn()
    window = supersampled(plotter)
    window.converge()
    moving(plotter)
    if not while_moving:
        plotter.render()
        plotter.render()
    change(plotter)
    if while_moving:
        turn(plotter, 0.5)
    ours = shown(plotter)
    window.disable()
    np.testing.assert_array_equal(ours, plain(plotter))


OBSERVERS: dict[str, Callable[[Any], Any]] = {
    "colour": lambda plotter: plotter.actors["floor"].GetProperty().SetColor(0.0, 0.0, 1.0),
    "place": lambda plotter: plotter.actors["floor"].SetPosition(0.3, 0.0, 0.0),
    "camera": lambda plotter: plotter.camera.SetPosition(2.0, -2.5, 2.0),
    "range of depth": lambda plotter: plotter.camera.SetClippingRange(3.7, 30.0),
}


@pytest.mark.parametrize("while_moving", [False, True], ids=["at rest", "moving"])
@pytest.mark.parametrize("source", ["render_window", "renderer"])
@pytest.mark.parametrize("change", OBSERVERS.values(), ids=OBSERVERS.keys())
def test_what_an_observer_of_the_start_of_a_render_changes_shows_at_once(
    plotter: Any, change: Callable[[Any], Any], source: str, while_moving: bool
) -> None:
    plotter.actors["floor"].mapper.ScalarVisibilityOff()
    window = supersampled(plotter)
    starts: list[int] = []

    def observe(*_: Any) -> None:
        starts.append(1)
        if is_on:
            change(plotter)

    is_on = False
    getattr(plotter, source).AddObserver("StartEvent", observe)
    window.converge()
    moving(plotter)
    if not while_moving:
        plotter.render()
        plotter.render()
    is_on = True
    starts.clear()
    if while_moving:
        turn(plotter, 0.5)
    ours = shown(plotter)
    assert len(starts) == 1
    window.converge()
    rest = seen(plotter)
    expected = without(window, plotter)
    assert np.abs(ours - expected).mean() < 0.01
    assert np.abs(rest - expected).mean() < 0.01


def test_a_surface_whose_vertices_a_shader_places_is_rendered_at_full_size(plotter: Any) -> None:
    code = "//VTK::PositionVC::Impl\ngl_Position.x += 0.1 * sin(4.0 * gl_Position.y);\n"
    floor = plotter.actors["floor"].GetShaderProperty()
    floor.AddVertexShaderReplacement("//VTK::PositionVC::Impl", True, code, False)
    window = supersampled(plotter)
    moving(plotter)
    np.testing.assert_array_equal(seen(plotter), without(window, plotter))


def test_a_frame_that_changes_is_rendered_once_and_the_next_one_is_waited_for(plotter: Any) -> None:
    waits: list[int] = []
    window = SupersampledWindow(plotter.render_window, plotter.renderers, wake=waits.append)
    window.converge()
    waits.clear()
    renders: list[int] = []
    plotter.renderer.AddObserver("EndEvent", lambda *_: renders.append(1))
    change_scalars(plotter)
    plotter.render()
    assert len(renders) == 1
    plotter.render()
    assert waits == [100, 10]


@pytest.mark.parametrize("beside", ["nothing", "a translucent surface"])
@pytest.mark.parametrize("kind", ["grid", "line", "points", "wireframe", "edges", "label"])
def test_lines_points_and_text_are_those_of_plain_pyvista_while_the_view_moves(
    plotter: Any, kind: str, beside: str
) -> None:
    plotter.remove_actor("floor", render=False)
    plotter.add_mesh(pv.Sphere(radius=0.7), color="white", lighting=False)
    plotter.set_background("white")
    block = pv.Cube(center=(1.2, 0, 0), x_length=0.7)
    cloud = pv.PolyData(np.random.default_rng(1).uniform(-1, 1, (200, 3)))
    places = [(0.0, -0.8, 0.2), (0.1, 1.0, -0.4), (0.9, 0.3, 0.4), (-0.9, 0.0, 0.0)]  # the second is hidden
    add: dict[str, Callable[[], Any]] = {
        "grid": lambda: plotter.show_grid(color="black"),
        "line": lambda: plotter.add_mesh(pv.Spline(cloud.points[:20], 400), color="black", line_width=3),
        "points": lambda: plotter.add_mesh(cloud, color="black", point_size=5, lighting=False),
        "wireframe": lambda: plotter.add_mesh(block, style="wireframe", color="black", lighting=False),
        "edges": lambda: plotter.add_mesh(block, show_edges=True, color="white", lighting=False),
        "label": lambda: plotter.add_point_labels(places, list("abcd"), text_color="black"),
    }
    add[kind]()
    if beside == "a translucent surface":
        plotter.add_mesh(
            pv.Sphere(radius=0.1, center=(-1.2, 0, 1)), color="grey", opacity=0.3, lighting=False
        )
    window = supersampled(plotter)
    plotter.render()
    moving(plotter)
    ours = seen(plotter)
    expected = without(window, plotter)
    ink = (1 - expected).mean()
    assert ink > 0.001
    assert np.abs(ours - expected).mean() < 0.1 * ink


@pytest.mark.parametrize("is_in_view", [True, False], ids=["in view", "out of view"])
def test_lines_that_were_never_rendered_are_those_of_plain_pyvista(is_in_view: bool) -> None:
    """VTK's mappers tell what they draw only when they have been rendered."""
    plotter = pv.Plotter(off_screen=True, window_size=SIZE)
    plotter.set_background("white")
    plotter.add_mesh(pv.Cube().outline(), color="black", line_width=3)
    plotter.add_mesh(pv.Sphere(radius=0.3), color="white", lighting=False)
    window = supersampled(plotter)
    plotter.camera_position = [(0.0, -4.0, 2.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]
    plotter.camera.Yaw(0.0 if is_in_view else 120.0)
    plotter.show(auto_close=False)
    plotter.camera.Yaw(0.0 if is_in_view else -120.0)
    moving(plotter)
    moving(plotter)
    ours = seen(plotter)
    expected = without(window, plotter)
    assert np.abs(ours - expected).mean() < 0.1 * (1 - expected).mean()
    plotter.close()


def test_a_line_that_moves_alone_shows_at_once(plotter: Any) -> None:
    line = plotter.add_mesh(pv.Line((-1, 0, 0.5), (1, 0, 0.5)), color="red", line_width=5, lighting=False)
    window = supersampled(plotter)
    moving(plotter)
    window.converge()
    line.SetPosition(0.0, -0.5, 0.0)
    ours = shown(plotter)
    expected = without(window, plotter)
    is_red, was_red = (image[..., 0] > image[..., 1] + 0.8 for image in (expected, ours))
    assert is_red.sum() > 300
    assert (is_red & was_red).sum() > 0.97 * max(is_red.sum(), was_red.sum())


def silhouette(plotter: Any) -> Callable[[], None]:
    """Its points follow the camera."""
    ball = pv.Sphere(radius=0.6, center=(0, 0, 0.7))
    plotter.add_mesh(ball, lighting=False, silhouette={"color": "black", "line_width": 4})
    return lambda: None


def trail(plotter: Any) -> Callable[[], None]:
    line = pv.Line((-1, -1, 0.5), (1, 1, 0.5))
    plotter.add_mesh(line, color="black", line_width=5, lighting=False)

    def change() -> None:
        line.points[1] -= (0.1, 0.0, 0.0)
        line.Modified()

    return change


@pytest.mark.parametrize("add", [silhouette, trail])
def test_lines_that_change_while_the_view_moves_are_those_of_plain_pyvista(
    plotter: Any, add: Callable[[Any], Callable[[], None]]
) -> None:
    plotter.remove_actor("floor", render=False)
    change = add(plotter)
    plotter.add_mesh(pv.Cube(x_length=0.5), color="white", lighting=False)
    window = supersampled(plotter)
    plotter.render()
    for _ in range(4):
        change()
        turn(plotter, 2.0)
        plotter.render()
    ours = seen(plotter)
    upscaler = window.viewports[0].upscaler
    assert upscaler is not None
    assert upscaler.stats.frames == 4
    expected = without(window, plotter)
    assert np.abs(ours - expected).mean() < 0.1 * (1 - expected).mean()


def test_depth_is_interpolated_exactly_on_planes_and_not_across_outlines() -> None:
    row, column = np.mgrid[:20, :30].astype(np.float32)
    plane = 0.3 + 0.001 * column + 0.002 * row
    plane[:, 20:] = 1.0
    larger = upsampled_depth(plane, (60, 40), (0.25, -0.125))
    y, x = np.mgrid[:40, :60].astype(np.float32)
    expected = 0.3 + 0.001 * ((x + 0.5) / 2 - 0.75) + 0.002 * ((y + 0.5) / 2 - 0.375)
    step = 0.5 * (0.001 + 0.002)  # lines on surfaces are in front by half a sample's step
    np.testing.assert_allclose(larger[4:36, 4:38], expected[4:36, 4:38] + step, atol=1e-5)
    outline = larger[4:36, 38:42]
    assert (outline >= expected[4:36, 38:42]).all()  # a line along it has no gaps
    assert (outline[outline < 1.0] < 0.37).all()
    assert set(np.unique(larger[:, 42:])) == {1.0}


def test_an_actors_mesh_is_examined_once_while_only_the_view_moves(
    plotter: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    window = supersampled(plotter)
    plotter.render()
    examined: list[Any] = []
    update = vtkDataSetMapper.Update

    def counted(mapper: Any) -> None:
        examined.append(mapper)
        update(mapper)

    monkeypatch.setattr(pv.DataSetMapper, "Update", counted, raising=False)
    moving(plotter)
    assert not examined
    change_scalars(plotter)
    plotter.render()
    assert len(examined) <= 2  # before and after the render
    assert window.viewports[0].upscaler is not None


@pytest.mark.parametrize(("glyph", "frames"), [(pv.Sphere(radius=0.2), 4), (pv.Line(), 0)])
def test_glyphs_are_upscaled_if_they_are_surfaces(plotter: Any, glyph: Any, frames: int) -> None:
    plotter.remove_actor("floor", render=False)
    mapper, actor = vtkGlyph3DMapper(), vtkActor()
    mapper.SetInputData(pv.PolyData(np.array([(0, 0, 0.5), (1, 0, 0.5)], np.float32)))  # with vertices
    mapper.SetSourceData(glyph)
    mapper.ScalarVisibilityOff()
    actor.SetMapper(mapper)
    actor.GetProperty().SetColor(0.0, 0.0, 0.0)
    actor.GetProperty().SetLineWidth(5)
    plotter.renderer.AddActor(actor)
    window = supersampled(plotter)
    plotter.render()
    moving(plotter)
    upscaler = window.viewports[0].upscaler
    assert (0 if upscaler is None else upscaler.stats.frames) == frames
    ours = seen(plotter)
    expected = without(window, plotter)
    assert (1 - expected).mean() > 0.001
    assert np.abs(ours - expected).mean() < 0.1 * (1 - expected).mean()


def test_each_viewport_has_its_own_history() -> None:
    plotter = side_by_side()
    window = supersampled(plotter)
    window.converge()
    resting = seen(plotter)[:, 160:]
    first = plotter.renderers[0]
    for _ in range(4):
        first.camera.Azimuth(1.0)
        plotter.render()
    ours = seen(plotter)
    upscalers = [viewport.upscaler for viewport in window.viewports]
    assert upscalers[0] is not None
    assert upscalers[0].stats.frames == 4
    assert upscalers[1] is None
    np.testing.assert_array_equal(ours[:, 160:], resting)
    assert np.abs(ours - without(window, plotter)).mean() < 0.05
    plotter.close()


def show_cloud(plotter: Any) -> None:
    """Show a volume around (0, 0, 0.75) in place of the floor."""
    grid = pv.ImageData(dimensions=(16, 16, 16), spacing=(0.1, 0.1, 0.1), origin=(-0.75, -0.75, 0.0))
    grid["density"] = np.exp(-6 * np.square(grid.points - (0.0, 0.0, 0.75)).sum(axis=1))
    plotter.remove_actor("floor", render=False)
    plotter.add_volume(grid, scalars="density", opacity="linear", show_scalar_bar=False)


def test_a_volume_moves_as_its_centre_and_in_no_blocks(plotter: Any) -> None:
    show_cloud(plotter)
    window = supersampled(plotter)
    plotter.render()
    moving(plotter)
    before = place(plotter, (0.0, 0.0, 0.75))
    plotter.camera.Elevation(2.0)
    frame = stepped(window, plotter)
    now = place(plotter, (0.0, 0.0, 0.75))
    column, row = np.floor(now).astype(int)
    np.testing.assert_allclose(frame.motion[row, column], before - now, atol=0.1)
    inside = frame.motion[row - 12 : row + 12, column - 12 : column + 12]
    assert np.abs(np.diff(inside, axis=0)).max() < 0.1
    assert np.abs(np.diff(inside, axis=1)).max() < 0.1
    assert frame.reactive is not None
    assert frame.reactive[row, column] > 0


def test_upscaling_that_does_not_pay_says_so_and_stays_out(plotter: Any) -> None:
    window = enable_supersampling(plotter)
    plotter.render()
    plotter.render()
    window.pace.plain = 1e-6
    with pytest.warns(UserWarning, match="does not pay"):
        moving(plotter)
    assert window.is_bypassed
    turn(plotter)
    ours = shown(plotter)
    window.converge()
    assert window.is_converged
    window.disable()
    np.testing.assert_array_equal(ours, plain(plotter))


def test_each_render_changes_nothing_of_the_plotter(plotter: Any) -> None:
    supersampled(plotter)
    before = plotter.renderer.GetViewport(), plotter.camera.GetWindowCenter(), plotter.render_window.GetSize()
    plotter.render()
    moving(plotter)
    after = plotter.renderer.GetViewport(), plotter.camera.GetWindowCenter(), plotter.render_window.GetSize()
    assert after == before
    assert all(prop.GetVisibility() for prop in plotter.renderer.GetViewProps())
    assert plotter.renderer.GetPreserveColorBuffer() == 0


@pytest.mark.skipif(XVFB is None, reason="xvfb-run cannot be found: Debian's xvfb and xauth have it")
def test_a_window_renders_on_by_a_timer_until_it_has_converged() -> None:
    assert in_a_window(CONVERGING) == ["vtkXOpenGLRenderWindow", "16"]


@pytest.mark.skipif(XVFB is None, reason="xvfb-run cannot be found: Debian's xvfb and xauth have it")
def test_timers_of_the_program_start_no_more_timers() -> None:
    seconds, timers = animated(60, 40, "timers")
    assert timers <= 1 + seconds / 0.09  # one at a time, of 100 ms, which may end early


@pytest.mark.skipif(XVFB is None, reason="xvfb-run cannot be found: Debian's xvfb and xauth have it")
def test_animations_by_a_timer_are_as_fast_as_without() -> None:
    seconds, steps = animated(12, 300, "frames")
    assert steps <= 2 + seconds / 0.3


def in_a_window(program: str) -> list[str]:
    """Run a program that uses `plotter` and `window`, on screen, and return the words that it prints."""
    command = [str(XVFB), "-a", sys.executable, "-c", WINDOW + program]
    done = subprocess.run(command, timeout=240, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


WINDOW = """
import pyvista
from supersampler.integrations.pyvista import enable_supersampling

plotter = pyvista.Plotter(window_size=(160, 120))
plotter.add_mesh(pyvista.Sphere())
window = enable_supersampling(plotter, scale=2, force=True)
plotter.iren.initialize()
interactor = plotter.iren.interactor
"""
CONVERGING = """
timers, waited = [], []  # the window system may have it render at any time: what counts is who asked for it
create = interactor.CreateOneShotTimer
interactor.CreateOneShotTimer = lambda ms: timers.append(ms) or create(ms)

def wait(*_):
    if window.is_converged:
        waited.append(len(timers))
    if len(waited) > 8:
        interactor.TerminateApp()

interactor.AddObserver("TimerEvent", wait)
interactor.CreateRepeatingTimer(100)
plotter.show(auto_close=False)
assert waited[0] == waited[-1] >= 16
print(plotter.render_window.GetClassName(), window.viewports[0].renders)
"""
ANIMATED = """
from time import perf_counter

frames, timers = [], []
create = interactor.CreateOneShotTimer
interactor.CreateOneShotTimer = lambda ms: timers.append(perf_counter()) or create(ms)

def animate(*_):  # one step an event, whoever has started the timer
    frames.append(perf_counter())
    plotter.camera.Azimuth(0.2)
    plotter.render()
    if len(frames) == COUNT:
        interactor.TerminateApp()

interactor.AddObserver("TimerEvent", animate)
interactor.CreateRepeatingTimer(PAUSE)
plotter.show(auto_close=False)
times = TIMES
print(times[-1] - times[0], len(times))
"""


def animated(count: int, pause: int, times: str) -> tuple[float, float]:
    """Animate `count` frames by a timer of `pause` ms; return the span and the number of these times.

    `times` is "frames", or "timers" that supersampling has started.
    """
    names = f"COUNT, PAUSE = {count}, {pause}\n"
    seconds, steps = map(float, in_a_window(names + ANIMATED.replace("TIMES", times)))
    return seconds, steps


def test_a_server_renders_on_in_its_event_loop_until_it_has_converged(plotter: Any) -> None:
    pytest.importorskip("trame_pyvista", reason="trame-pyvista is not installed here")
    from trame.app import get_server
    from trame.ui.vuetify3 import SinglePageLayout
    from trame_pyvista.ui import plotter_ui
    from trame_vtk.modules.vtk import get_helper

    window = supersampled(plotter)

    async def serve() -> None:
        server = get_server("supersampler", client_type="vue3")
        with SinglePageLayout(server) as layout, layout.content:
            plotter_ui(plotter, mode="server", server=server)
        server.start(exec_mode="task", port=0, open_browser=False, show_connection_info=False)
        while not server.running:
            await asyncio.sleep(0.05)
        view = get_helper(server).id(plotter.render_window)
        server.protocol_call("viewport.image.push.observer.add", view)  # as a browser that connects
        plotter.render()
        assert not window.is_converged
        while not window.is_converged:
            await asyncio.sleep(0.05)
        await server.stop()

    asyncio.run(asyncio.wait_for(serve(), 200))


def test_the_server_side_of_trame_and_jupyter_sends_the_same_images(plotter: Any, tmp_path: Path) -> None:
    """Both ask `vtkWebApplication`, which comes with VTK, for a JPEG of the window."""
    window = supersampled(plotter)
    window.converge()
    SERVER.SetImageEncoding(0)  # bytes, not base64
    jpeg = vtk_to_numpy(SERVER.StillRender(plotter.render_window, 100))
    (tmp_path / "sent.jpg").write_bytes(jpeg.tobytes())
    sent = np.asarray(ImageBuf(str(tmp_path / "sent.jpg")).get_pixels("float"))
    assert window.is_converged
    assert np.abs(sent[..., :3] - seen(plotter)).mean() < 0.01


@pytest.mark.parametrize("name", GALLERY)
def test_scenes_of_the_gallery_are_those_of_plain_pyvista(name: str) -> None:
    plotter = pv.Plotter(off_screen=True, window_size=(480, 270))
    GALLERY[name](plotter)
    window = supersampled(plotter, scale=None)
    plotter.show(auto_close=False)
    ours, rest, expected = in_turn(window, plotter)
    assert np.abs(ours - expected).mean() < 0.02
    assert np.abs(rest - expected).mean() < 0.015
    plotter.close()


def test_other_things_than_an_open_plotter_are_refused(plotter: Any) -> None:
    plotter.enable_anti_aliasing("ssaa")
    with pytest.raises(ArgumentError, match="plotter is 3; want an open"):
        enable_supersampling(3)
    with pytest.raises(ArgumentError, match=r"scale is 0\.5; want a number >= 1"):
        enable_supersampling(plotter, scale=0.5)
    with pytest.raises(ArgumentError, match=r"scale is 3\.5; want 1\.0 to 3\.0 for 'classifier'"):
        enable_supersampling(plotter, scale=3.5)
    with pytest.raises(ArgumentError, match="one that reads no G-buffers"):
        enable_supersampling(plotter, model="gbuffer-fast")
    with pytest.raises(ArgumentError, match="window is None; want a vtkRenderWindow"):
        SupersampledWindow(None, [])
    with pytest.raises(ArgumentError, match="want renderers of the window"):
        SupersampledWindow(plotter.render_window, [vtkRenderer()])
    assert plotter.renderer.GetPass() is not None, "a refused call leaves anti-aliasing on"
    plotter.close()
    with pytest.raises(ArgumentError, match="plotter is closed"):
        enable_supersampling(plotter)


def side_by_side() -> Any:
    """A plotter that shows two subplots of the same floor."""
    plotter = pv.Plotter(off_screen=True, window_size=(320, 160), shape=(1, 2))
    checks = (np.indices((24, 24)).sum(axis=0) % 2).ravel()
    for column in range(2):
        plotter.subplot(0, column)
        plane = pv.Plane(i_size=4, j_size=4, i_resolution=24, j_resolution=24)
        plotter.add_mesh(plane, scalars=checks, cmap="gray", show_scalar_bar=False, lighting=False)
        plotter.camera_position = [(1.5, -3.0, 2.0), (0, 0, 0), (0, 0, 1)]
    plotter.show(auto_close=False)
    return plotter


def test_linked_views_are_those_of_views_alone() -> None:
    images = []
    for is_linked in (False, True):
        plotter = side_by_side()
        if is_linked:
            plotter.link_views()
        window = supersampled(plotter)
        plotter.render()
        for _ in range(4):
            for camera in {id(r.camera): r.camera for r in plotter.renderers}.values():
                camera.Azimuth(0.5)
            plotter.render()
        images.append(seen(plotter))
        window.converge()
        images.append(seen(plotter))
        plotter.close()
    np.testing.assert_array_equal(images[2], images[0])
    np.testing.assert_array_equal(images[3], images[1])


def test_viewports_that_overlap_are_those_of_plain_pyvista() -> None:
    plotter = side_by_side()
    plotter.renderers[0].SetViewport(0.0, 0.0, 1.0, 1.0)
    plotter.renderers[1].SetViewport(0.1, 0.1, 0.6, 0.6)
    plotter.subplot(0, 0)
    window = supersampled(plotter)
    plotter.render()
    ours, rest, expected = in_turn(window, plotter)
    np.testing.assert_array_equal(ours, expected)
    np.testing.assert_array_equal(rest, expected)
    plotter.close()


def test_a_renderer_that_is_not_drawn_is_not_seen() -> None:
    plotter = side_by_side()
    first, second = plotter.renderers[:2]
    for renderer in (first, second):
        renderer.SetViewport(0.0, 0.0, 1.0, 1.0)
    second.SetBackground(1.0, 0.0, 0.0)
    window = supersampled(plotter)
    for drawn, other in ((second, first), (first, second)):
        drawn.SetDraw(1)
        other.SetDraw(0)
        window.converge()
        for _ in range(4):
            drawn.camera.Azimuth(0.5)
            plotter.render()
        ours = seen(plotter)
        window.converge()
        rest = seen(plotter)
    assert [viewport.upscaler.stats.frames for viewport in window.viewports] == [4, 4]  # type: ignore[union-attr]
    expected = without(window, plotter)
    assert np.abs(ours - expected).mean() < 0.05
    assert np.abs(rest - expected).mean() < 0.02
    plotter.close()


def test_actors_in_two_viewports_are_seen_in_both() -> None:
    plotter = side_by_side()
    plotter.renderers[0].RemoveAllViewProps()
    plotter.renderers[0].AddActor(plotter.renderers[1].GetViewProps().GetLastProp())
    window = supersampled(plotter)
    window.converge()
    for _ in range(4):
        plotter.renderers[0].camera.Azimuth(0.5)
        plotter.render()
    ours = seen(plotter)
    window.disable()
    assert np.abs(ours - plain(plotter)).mean() < 0.05
    plotter.close()


def test_a_window_of_vtk_sets_its_camera_to_the_scene_as_without() -> None:
    images = []
    for is_ours in (False, True):
        window, renderer, actor = vtkRenderWindow(), vtkRenderer(), vtkActor()
        window.SetOffScreenRendering(1)
        window.SetSize(120, 90)
        window.SetMultiSamples(4)
        window.AddRenderer(renderer)
        actor.SetMapper(pv.DataSetMapper(pv.Cube()))
        renderer.AddActor(actor)
        if is_ours:
            SupersampledWindow(window, renderer)
        window.Render()
        images.append(WindowPixels(window).read_color(Rectangle(0, 0, 120, 90)).copy())
    np.testing.assert_array_equal(images[0], images[1])


def test_an_assembly_within_a_translucent_surface_is_that_of_plain_pyvista(plotter: Any) -> None:
    assembly, ball = vtkPropAssembly(), vtkActor()
    ball.SetMapper(pv.DataSetMapper(pv.Sphere(radius=0.4, center=(0, 0, 0.5))))
    assembly.AddPart(ball)
    plotter.renderer.AddActor(assembly)
    plotter.add_mesh(pv.Sphere(radius=0.9, center=(0, 0, 0.5)), color="red", opacity=0.4)
    window = supersampled(plotter)
    first = shown(plotter)
    window.converge()
    rest = seen(plotter)
    ball.SetPosition(0.2, 0.0, 0.0)
    moved = shown(plotter)
    window.disable()
    np.testing.assert_array_equal(moved, plain(plotter))
    ball.SetPosition(0.0, 0.0, 0.0)
    expected = plain(plotter)
    np.testing.assert_array_equal(first, expected)
    assert np.abs(rest - expected).mean() < 0.02


def test_a_slider_that_moves_at_rest_has_one_knob(plotter: Any) -> None:
    plotter.remove_actor("floor", render=False)
    slider = plotter.add_slider_widget(print, (0.0, 1.0))
    window = supersampled(plotter)
    window.converge()
    slider.GetRepresentation().SetValue(0.9)
    ours = shown(plotter)
    window.converge()
    rest = seen(plotter)
    expected = without(window, plotter)
    assert (1 - expected).mean() > 0.005
    np.testing.assert_array_equal(ours, expected)
    np.testing.assert_array_equal(rest, expected)


@pytest.mark.parametrize("samples", [0, 4])
def test_surfaces_are_peeled_as_without_multi_sampling(plotter: Any, samples: int) -> None:
    plotter.remove_actor("floor", render=False)
    for radius, color in ((0.4, "red"), (0.7, "lime"), (1.0, "blue")):
        plotter.add_mesh(pv.Sphere(radius=radius), color=color, opacity=0.4, lighting=False)
    plotter.render_window.SetMultiSamples(0)
    plotter.renderer.enable_depth_peeling(10)
    before = shown(plotter)
    plotter.render_window.SetMultiSamples(samples)
    window = supersampled(plotter)
    np.testing.assert_array_equal(shown(plotter), before)
    window.converge()
    assert np.abs(seen(plotter) - before)[40:120, 80:160].mean() < 0.01


def project(plotter: Any) -> None:
    camera = plotter.camera
    camera.SetExplicitProjectionTransformMatrix(camera.GetProjectionTransformMatrix(1.5, -1, 1))
    camera.SetUseExplicitProjectionTransformMatrix(True)


def skew(plotter: Any) -> None:
    camera = plotter.camera
    camera.SetScreenBottomLeft(-0.6, -0.4, -1.0)
    camera.SetScreenBottomRight(0.5, -0.4, -1.0)
    camera.SetScreenTopRight(0.5, 0.5, -1.0)
    camera.SetEyePosition((0.1, 0.0, 3.0))
    camera.SetUseOffAxisProjection(True)


def put_under(plotter: Any) -> None:
    """Draw another renderer first, in the whole window."""
    other = vtkRenderer()
    other.SetBackground(1.0, 0.0, 0.0)
    plotter.renderer.SetViewport(0.5, 0.5, 1.0, 1.0)
    plotter.render_window.RemoveRenderer(plotter.renderer)
    plotter.render_window.AddRenderer(other)
    plotter.render_window.AddRenderer(plotter.renderer)


COMPOSED: dict[str, Callable[[Any], Any]] = {
    "projection": project,
    "off-axis projection": skew,
    "another renderer below": put_under,
    "FXAA": lambda plotter: plotter.renderer.UseFXAAOn(),
    "SSAO": lambda plotter: plotter.renderer.UseSSAOOn(),
    "pass": lambda plotter: plotter.enable_depth_of_field(),
}


@pytest.mark.parametrize("compose", COMPOSED.values(), ids=COMPOSED.keys())
def test_what_is_more_than_a_render_of_props_is_rendered_as_without(
    plotter: Any, compose: Callable[[Any], Any]
) -> None:
    window = supersampled(plotter)
    window.converge()
    compose(plotter)
    ours, rest, expected = in_turn(window, plotter)
    np.testing.assert_array_equal(ours, expected)
    np.testing.assert_array_equal(rest, expected)


@pytest.mark.parametrize(("size", "scale"), [((240, 160), 1.75), ((241, 161), 2), ((482, 271), 1.75)])
def test_a_moving_image_is_where_the_view_is(plotter: Any, size: tuple[int, int], scale: float) -> None:
    plotter.render_window.SetSize(*size)
    window = supersampled(plotter, scale=scale)
    plotter.render()
    moving(plotter)
    place_of = window.viewports[0]
    for _ in range(8):
        plotter.render_window.Modified()
        turn(plotter, 0.02)
        plotter.render()
    assert place_of.upscaler is not None
    ours = seen(plotter)
    expected = without(window, plotter)
    for columns in (slice(8, size[0] // 4), slice(-size[0] // 4, -8)):
        one, other = ours[:, columns].mean(axis=-1), expected[:, columns].mean(axis=-1)
        slope = np.gradient(other, axis=1)
        shift = (slope * (one - other)).sum() / np.square(slope).sum()
        assert abs(shift) < 0.08


@pytest.mark.parametrize("is_moving", [False, True])
def test_a_transparent_background_stays_transparent(plotter: Any, is_moving: bool) -> None:
    plotter.camera.zoom(0.5)
    window = supersampled(plotter)
    window.converge()
    if is_moving:
        moving(plotter)
    image = plotter.screenshot(transparent_background=True, return_img=True)
    window.disable()
    plain(plotter)
    expected = plotter.screenshot(transparent_background=True, return_img=True)
    assert image.shape == expected.shape == (SIZE[1], SIZE[0], 4)
    assert (expected[..., 3] == 0).mean() > 0.3
    off = np.abs(image[..., 3].astype(int) - expected[..., 3])
    assert (off > 64).mean() < 0.02


def test_a_volume_at_rest_does_not_move_with_something_else(plotter: Any) -> None:
    show_cloud(plotter)
    ball = plotter.add_mesh(pv.Sphere(radius=0.1, center=(1.2, 0, 0)), color="red")
    window = supersampled(plotter)
    plotter.render()
    for index in range(3):
        ball.SetPosition(0.0, 0.0, 0.1 * index + 0.1)
        frame = stepped(window, plotter)
    column, row = np.floor(place(plotter, (0.0, 0.0, 0.75))).astype(int)
    assert np.abs(frame.motion).max() > 0.5
    np.testing.assert_allclose(frame.motion[row - 8 : row + 8, column - 8 : column + 8], 0.0, atol=1e-6)


@pytest.mark.parametrize("width", [0.2, 0.4])
def test_axes_in_a_corner_are_those_of_plain_pyvista_but_for_fxaa_in_motion(
    plotter: Any, width: float
) -> None:
    plotter.remove_actor("floor", render=False)
    plotter.add_axes(viewport=(0.0, 0.0, width, width))
    plotter.add_mesh(pv.Sphere(radius=0.1))
    window = supersampled(plotter)
    plotter.render()
    moving(plotter)
    is_small = width < 0.25
    assert (plotter.render_window.GetMultiSamples() == 0) == is_small  # which slows down the whole window
    ours, rest, expected = in_turn(window, plotter)
    corner = slice(round(160 * (1 - width)), 160), slice(0, round(240 * width))
    assert (1 - expected[corner]).sum() > 115.0
    assert np.abs(ours[corner] - expected[corner]).mean() <= 0.01 * is_small
    np.testing.assert_array_equal(rest[corner], expected[corner])


def test_frames_in_which_vtk_adjusts_do_not_tell_whether_upscaling_pays() -> None:
    pace = Pace(None, (1.0, 2.0), force=False)
    for _ in range(2):
        pace.add(None, 0.1)
    for seconds in (0.3, 0.2, 0.15, 0.05):
        pace.add(2.0, seconds)
        assert pace.pays
    pace.add(2.0, 0.5)
    assert not pace.pays


def test_a_skybox_moves_with_the_directions_of_the_camera(plotter: Any) -> None:
    texture = pv.Texture(np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8))
    cube = pv.Texture(texture)
    sky = vtkOpenGLSkybox()
    sky.SetProjectionToSphere()
    sky.SetTexture(cube)
    plotter.remove_actor("floor", render=False)
    plotter.add_mesh(pv.Sphere(radius=0.2))
    plotter.renderer.AddActor(sky)
    window = supersampled(plotter)
    plotter.render()
    moving(plotter)
    plotter.camera.Yaw(1.0)
    frame = stepped(window, plotter)
    corner = frame.motion[4:12, 4:12]
    assert frame.depth[4:12, 4:12].max() == 0.0
    focal = 0.5 * SMALL[1] / np.tan(np.radians(0.5 * plotter.camera.view_angle))
    assert np.abs(corner[..., 0]).mean() == pytest.approx(focal * np.radians(1.0), rel=0.3)


def selected(plotter: Any) -> set[int]:
    selector = vtkHardwareSelector()
    selector.SetRenderer(plotter.renderer)
    selector.SetArea(60, 40, 180, 120)
    selector.SetFieldAssociation(1)
    node = selector.Select().GetNode(0)
    return set(vtk_to_numpy(node.GetSelectionList()).tolist())


def test_the_screenshot_of_the_tutorials_script_has_converged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PyVista places the camera when it first shows a plotter: what has converged before is another view."""
    page = (Path(__file__).parents[2] / "docs/tutorials/pyvista.md").read_text(encoding="utf-8")
    script = re.findall(r"^In scripts, .*?```python\n(.*?)```", page, re.DOTALL | re.MULTILINE)[0]
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"enable_supersampling": enable_supersampling}
    names["plotter"] = pv.Plotter(off_screen=True, window_size=SIZE)
    names["plotter"].add_mesh(pv.examples.load_airplane())
    exec(script, names)  # noqa: S102
    assert names["window"].is_converged
    assert (tmp_path / "image.png").exists()
    names["plotter"].close()


def test_cells_are_selected_as_without(plotter: Any) -> None:
    before = selected(plotter)
    window = supersampled(plotter)
    window.converge()
    image = seen(plotter)
    assert selected(plotter) == before
    np.testing.assert_array_equal(shown(plotter), image)


@pytest.mark.parametrize("is_moving", [False, True])
def test_depth_can_be_read_of_any_image(plotter: Any, is_moving: bool) -> None:
    window = supersampled(plotter)
    window.converge()
    if is_moving:
        moving(plotter)
    pixels, whole = WindowPixels(plotter.render_window), Rectangle(0, 0, *SIZE)
    ours = pixels.read_depth(whole)
    window.disable()
    plotter.render_window.SetMultiSamples(0)
    plotter.render()
    expected = pixels.read_depth(whole)
    off = np.abs(ours - expected) / (np.median(expected[expected < 1]) - expected.min())
    assert np.median(off) < 0.01
    assert (off > 0.05).mean() < 0.03


def test_a_surface_that_a_matrix_flattens_shows_at_once(plotter: Any) -> None:
    ball = plotter.add_mesh(pv.Sphere(radius=0.4, center=(0, 0, 0.5)), color="red")
    window = supersampled(plotter)
    window.converge()
    for scale in ((1.0, 1.0, 0.0), (0.0, 0.0, 0.0)):
        ball.SetScale(*scale)
        ours = shown(plotter)
        window.disable()
        np.testing.assert_array_equal(ours, plain(plotter))
        window = supersampled(plotter)
        window.converge()


@pytest.mark.parametrize("width", [0, 1])
def test_a_viewport_without_pixels_or_with_few_leaves_the_others_alone(width: int) -> None:
    plotter = side_by_side()
    window = supersampled(plotter, scale=3)
    plotter.renderers[0].SetViewport(0, 0, width / 320, width)
    plotter.renderers[1].SetViewport(width / 320, 0, 1, 1)
    for _ in range(3):
        window.converge()
        for renderer in plotter.renderers:
            renderer.camera.Azimuth(0.01)
        plotter.render()
    assert window.viewports[1].upscaler.stats.frames == 3  # type: ignore[union-attr]
    plotter.close()


def test_enabled_twice_the_second_counts(plotter: Any) -> None:
    supersampled(plotter)
    plotter.render()
    window = supersampled(plotter)
    window.converge()
    assert window.is_converged
    window.disable()
    assert plotter.render_window.GetMultiSamples() > 0


def test_samples_that_the_program_sets_later_stay(plotter: Any) -> None:
    window = supersampled(plotter)
    plotter.render()
    plotter.enable_anti_aliasing("msaa", multi_samples=2)
    moving(plotter)
    window.converge()
    window.disable()
    assert plotter.render_window.GetMultiSamples() == 2


@pytest.mark.parametrize("times", [1, 2])
def test_disabled_the_plotter_has_its_anti_aliasing_again(plotter: Any, times: int) -> None:
    plotter.disable_anti_aliasing()
    plotter.enable_anti_aliasing("ssaa")
    before = shown(plotter)
    for _ in range(times):
        window = supersampled(plotter)
    moving(plotter)
    assert window.viewports[0].upscaler is not None
    turn(plotter, -2.0)
    window.disable()
    np.testing.assert_array_equal(shown(plotter), before)
    plotter.disable_anti_aliasing()
    window.disable()  # once more changes nothing
    assert plotter.renderer.GetPass() is None


def test_disabled_within_a_frame_the_window_renders_as_it_did(plotter: Any) -> None:
    before = shown(plotter)
    window = supersampled(plotter)
    moving(plotter)
    plotter.renderer.AddObserver("EndEvent", lambda *_: window.disable())
    turn(plotter, -2.0)
    plotter.render()
    assert plotter.render_window.GetSwapBuffers() == 1
    np.testing.assert_array_equal(shown(plotter), before)


def test_observers_of_the_window_see_one_render_and_the_image_of_each_frame(plotter: Any) -> None:
    ball = plotter.add_mesh(pv.Sphere(radius=0.4, center=(0, 0, 0.5)), color="red")
    images: list[Float32] = []
    plotter.render_window.AddObserver("EndEvent", lambda *_: images.append(seen(plotter)))
    supersampled(plotter).converge()
    for index in range(3):
        ball.SetPosition(0.0, 0.0, 0.02 * index)
        turn(plotter)
        images.clear()
        np.testing.assert_array_equal(shown(plotter)[None], images)


def test_an_error_within_a_frame_leaves_a_plain_image(
    plotter: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    window = supersampled(plotter)
    plotter.render()
    moving(plotter)
    with monkeypatch.context() as patched:
        patched.setattr(window.viewports[0], "upscale", lambda _: 1 / 0)
        turn(plotter)
        ours = shown(plotter)
    assert "ZeroDivisionError" in capsys.readouterr().err
    moving(plotter)
    assert window.viewports[0].upscaler is not None
    turn(plotter, -2.0)
    window.disable()
    np.testing.assert_array_equal(ours, plain(plotter))
