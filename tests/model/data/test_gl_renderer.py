"""The renderer, compared with analytic results for light, surfaces and sampling."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gl_scenes import Yard, box, fence_texture, moved, plane, unlit
from supersampler_model.data.errors import SceneError
from supersampler_model.data.renderer import renderer as module
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.procedural import shapes
from supersampler_model.data.scenes.procedural.paths import turned_by
from supersampler_model.data.scenes.scene import (
    Camera,
    Environment,
    Instance,
    Material,
    Particles,
    PointLight,
    Scene,
    Spot,
    Sun,
    Texture,
    harmonics,
)

MATTE = Material(base_color=(0.5, 0.25, 1.0), roughness=1.0, specular=0.0)
ABOVE = Camera(position=(0.0, 4.0, 0.0), target=(0.0, 0.0, 0.0), up=(0.0, 0.0, -1.0))  # x right, -z up
MIDDLE = (45, 80)  # row, column
COVER = Instance(mesh=plane(2.0), material=MATTE, model=moved(0, 2, 0, 0.5))  # casts a shadow
LOW = replace(ABOVE, position=(0.0, 1.8, 0.0), fov_y=75.0)  # below COVER
ROW, COLUMN = np.mgrid[:90, :160]
OFF = np.maximum(np.abs(COLUMN - 79.5), np.abs(ROW - 44.5)) * 1.8 * np.tan(np.radians(37.5)) / 45.0
"""Metres from the middle of what LOW sees."""


def uniform(radiance: float) -> Environment:
    return Environment(pixels=np.full((32, 64, 3), radiance, np.float32))


def seen_from(camera: Camera, *instances: Instance, radiance: float = 0.0, **lights: Any) -> Scene:
    return Scene(
        camera=camera, camera_before=camera, environment=uniform(radiance), instances=instances, **lights
    )


def floor(material: Material = MATTE) -> Instance:
    return Instance(mesh=plane(1.0), material=material, model=moved(0, 0, 0, (9, 1, 9)))


def middle(renderer: Renderer, scene: Scene) -> NDArray[np.float32]:
    return np.asarray(renderer.reference(scene).color[MIDDLE])


# --- light ---


def test_a_matte_floor_reflects_its_albedo_of_all_lights(renderer: Renderer) -> None:
    white, base = (np.pi, np.pi, np.pi), np.array(MATTE.base_color)
    sun = Sun(direction=(0.0, -1.0, -1.0), color=white, radius=10.0)
    point = PointLight(position=(0.0, 2.0, 0.0), color=white, reach=1000.0)
    spot = Spot(position=(0.0, 2.0, 0.0), target=(0.0, 0.0, 0.0), color=white, reach=1000.0)
    for scene, share in (
        (seen_from(ABOVE, floor(), radiance=0.8), 0.8),
        (seen_from(ABOVE, floor(), sun=sun), np.cos(np.pi / 4)),
        (seen_from(ABOVE, floor(), points=(point,)), 1.0 / 2.0**2),
        (seen_from(ABOVE, floor(), spot=spot), 1.0 / 2.0**2),
    ):  # Fresnel leaves a little even with specular 0
        np.testing.assert_allclose(middle(renderer, scene), share * base, rtol=0.01, atol=0.002)


def test_a_metal_ball_nearly_vanishes_in_a_uniform_room(renderer: Renderer) -> None:
    chrome = Material(roughness=0.1, metallic=1.0)
    here = Instance(mesh=shapes.ball(), material=chrome, model=moved(0, 0, 0))
    color = renderer.reference(seen_from(ABOVE, here, radiance=0.7)).color
    np.testing.assert_allclose(color, 0.7, rtol=0.06)  # what the fit of the BRDF's integral loses


@pytest.mark.parametrize(
    ("light", "half"),
    [
        ({"sun": Sun(direction=(0.0, -1.0, 0.0), color=(1.0, 1.0, 1.0), radius=3.0)}, 0.5),
        ({"spot": Spot(position=(0, 4, 0), target=(0, 0, 0), color=(9, 9, 9), inner=50.0, outer=60.0)}, 1.0),
    ],
    ids=["sun", "spot"],
)
def test_shadows_fall_under_objects_and_nowhere_else(renderer: Renderer, light: Any, half: float) -> None:
    holes = Material(base_color_texture=fence_texture(), alpha_cutoff=0.5)
    lit, covered, fenced = (
        renderer.reference(seen_from(LOW, floor(), *things, **light)).color[..., 0]
        for things in ((), (COVER,), (replace(COVER, material=holes),))
    )
    assert lit.min() > 0.01
    assert (covered[half - 0.05 > OFF] < 1e-4).all()
    np.testing.assert_allclose(covered[half + 0.05 < OFF], lit[half + 0.05 < OFF], rtol=1e-3)  # no acne
    share = fenced[half > OFF].sum() / lit[half > OFF].sum()
    assert 0.3 < share < 0.8  # light falls through holes
    unshadowed = renderer.truth(seen_from(LOW, floor(), COVER, **light)).unshadowed
    assert (unshadowed[half - 0.06 > OFF] == 0.0).all()
    assert (unshadowed[half + 0.12 < OFF] == 1.0).all()
    assert ((unshadowed > 0.0) & (unshadowed < 1.0)).any()  # the mean over a pixel's samples


def test_pixel_truth_is_coverage_by_kind_of_object(renderer: Renderer) -> None:
    def slab(x: float, *, before: float, thin: bool) -> Instance:
        """Return a level square of 1 m, 1 m above the floor."""
        model, earlier = (moved(at, 1.0, 0.0, 0.5) for at in (x, before))
        return Instance(mesh=plane(1.0), material=MATTE, model=model, model_before=earlier, thin=thin)

    slabs = {
        "thin_still": slab(-2.0, before=-2.0, thin=True),
        "thin_moving": slab(0.0, before=0.1, thin=True),
        "moving": slab(2.0, before=2.1, thin=False),
    }
    scene = seen_from(ABOVE, floor(), *slabs.values())
    truth, samples = renderer.truth(scene), renderer.samples_truth(scene, (80, 45), jitter=(0.25, 0.1))
    _, surfaces = renderer.frame(scene, (80, 45), jitter=(0.25, 0.1))
    pixel = 2.0 * 3.0 * np.tan(np.radians(30.0)) / 90.0  # metres, 3 m from the camera
    area = (1.0 / pixel) ** 2
    for index, name in enumerate(slabs):
        plane_of = getattr(truth, name).astype(float)
        assert plane_of.sum() == pytest.approx(area, rel=0.03)
        column = (plane_of.sum(axis=0) * np.arange(160)).sum() / plane_of.sum()
        assert column == pytest.approx(79.5 + 2.0 * (index - 1) / pixel, abs=0.5)
        assert set(np.unique(getattr(samples, name))) == {0.0, 1.0}
        assert (surfaces.depth[getattr(samples, name) == 1.0] > 0.03).all()  # 0.1 / 3
    nothing = sum(getattr(samples, name) for name in slabs) == 0.0
    assert (surfaces.depth[nothing] < 0.03).all()  # 0.1 / 4
    assert truth.unshadowed.min() == 1.0  # no light casts shadows


def test_a_far_fence_is_as_dense_as_a_near_one(renderer: Renderer) -> None:
    glowing = Material(
        base_color=(0.0, 0.0, 0.0), specular=0.0, emissive=(1.0, 1.0, 1.0),
        base_color_texture=fence_texture(), alpha_cutoff=0.5,
    )  # fmt: skip
    fence = Instance(mesh=plane(6.0), material=glowing, model=moved(0, 0, 0))
    light = []
    for distance in (3.0, 12.0, 24.0):  # metres; 8, 31 and 62 texels of 64 to a pixel
        camera = replace(ABOVE, position=(0.0, distance, 0.0))
        light.append(renderer.reference(seen_from(camera, fence)).color.sum() * distance**2)
    np.testing.assert_allclose(light, light[0], rtol=0.1)


def test_normal_maps_lean_to_the_right_and_up(renderer: Renderer) -> None:
    lean = Texture(pixels=np.full((4, 4, 3), (218, 128, 218), np.uint8), srgb=False)
    rise = Texture(pixels=np.full((4, 4, 3), (128, 218, 218), np.uint8), srgb=False)
    half = np.sqrt(0.5)
    for texture, want in (
        (lean, (half, half, 0.0)),
        (rise, (0.0, half, -half)),
    ):  # u is x; v, downwards, is z
        surfaces = renderer.display(seen_from(ABOVE, floor(replace(MATTE, normal_texture=texture))))
        np.testing.assert_allclose(surfaces.normal[MIDDLE], want, atol=0.01)
        np.testing.assert_allclose(surfaces.smooth_normal[MIDDLE], (0, 1, 0), atol=1e-3)


def test_material_maps_multiply_the_constants(renderer: Renderer) -> None:
    orm = Texture(pixels=np.full((4, 4, 3), (0, 51, 204), np.uint8), srgb=False)
    paint = Texture(pixels=np.full((4, 4, 3), (188, 0, 255), np.uint8))
    material = Material(
        base_color=(1.0, 1.0, 0.5), roughness=0.5, metallic=0.5, specular=0.25,
        orm_texture=orm, base_color_texture=paint,
    )  # fmt: skip
    surfaces = renderer.display(seen_from(ABOVE, floor(material)))
    np.testing.assert_allclose(surfaces.base_color[MIDDLE], (0.503, 0.0, 0.5), atol=2e-3)
    found = [float(image[MIDDLE]) for image in (surfaces.roughness, surfaces.metallic, surfaces.specular)]
    np.testing.assert_allclose(found, (0.1, 0.4, 0.25), atol=1e-3)


def test_particles_are_in_the_colour_and_nowhere_else(renderer: Renderer) -> None:
    puff = Particles(
        centers=np.array([[0.0, 1.0, 0.0]], np.float32),
        radii=np.array([0.5], np.float32),
        colors=np.array([[3.0, 0.0, 0.0, 0.5]], np.float32),
    )
    bare = seen_from(ABOVE, floor(), radiance=0.5)
    with_puff = replace(bare, particles=(puff,))
    hidden = replace(with_puff, particles=(replace(puff, centers=puff.centers * np.float32(-1.0)),))
    (without, a), (there, b) = (renderer.frame(s, (80, 45), jitter=(0.0, 0.0)) for s in (bare, with_puff))
    assert_same_buffers(a, b)
    np.testing.assert_allclose(there[22, 40], 0.5 * without[22, 40] + (3.0, 0.0, 0.0), rtol=0.02)
    np.testing.assert_array_equal(renderer.frame(hidden, (80, 45), jitter=(0.0, 0.0))[0], without)
    np.testing.assert_array_equal(renderer.reference(with_puff).depth_min, renderer.reference(bare).depth_min)


# --- surfaces and samples ---


def test_depth_is_near_over_distance(renderer: Renderer) -> None:
    surfaces = renderer.display(seen_from(ABOVE, floor()))
    np.testing.assert_allclose(surfaces.depth, 0.1 / 4.0, rtol=1e-5)  # view distance, not length of the ray
    np.testing.assert_allclose(surfaces.previous_depth, 0.1 / 4.0, rtol=1e-5)


@pytest.mark.parametrize(
    ("x", "z", "rows", "columns"),
    [(0.0, -1.0, slice(0, 45), slice(40, 120)), (1.0, 0.0, slice(25, 65), slice(80, 160))],
    ids=["up", "right"],
)
def test_row_0_is_on_top_and_x_points_right(
    renderer: Renderer, x: float, z: float, rows: slice, columns: slice
) -> None:
    here = Instance(mesh=box(), material=MATTE, model=moved(x, 0, z, 0.3))
    seen = renderer.display(seen_from(ABOVE, here)).depth > 0.0
    assert seen.any()
    assert seen[rows, columns].sum() == seen.sum()


def test_the_sky_has_no_surface_but_moves_with_the_camera(renderer: Renderer) -> None:
    camera = Camera(position=(0.0, 0.0, 0.0), target=(0.0, 0.0, -1.0), fov_y=60.0)
    turn = replace(camera, target=(np.tan(np.radians(1.0)), 0.0, -1.0))  # by 1 degree to the right
    surfaces = renderer.display(replace(seen_from(turn), camera_before=camera))
    assert not any(image.any() for image in surfaces.gbuffer().values())
    assert not surfaces.depth.any()
    assert not surfaces.previous_depth.any()
    want = np.tan(np.radians(1.0)) / np.tan(np.radians(30.0)) * 45.0  # what is in the middle was right of it
    np.testing.assert_allclose(surfaces.motion[MIDDLE], (want, 0.0), atol=0.01 * want)


def test_points_behind_the_previous_camera_were_off_screen(renderer: Renderer) -> None:
    before = replace(ABOVE, position=(0.0, -1.0, 0.0), target=(0.0, -2.0, 0.0))
    surfaces = renderer.display(replace(seen_from(ABOVE, floor()), camera_before=before))
    assert (np.abs(surfaces.motion) >= (160, 90)).any(axis=-1).all()
    assert np.isfinite(surfaces.previous_depth).all()


def test_a_mirrored_model_shows_its_front(renderer: Renderer) -> None:
    mirrored = moved(0, 0, 0) @ np.diag([-1.0, 1.0, 1.0, 1.0]) @ turned_by(1, 0.3)
    here = Instance(mesh=box(), material=MATTE, model=mirrored)
    np.testing.assert_allclose(renderer.display(seen_from(ABOVE, here)).depth[MIDDLE], 0.1 / 3.0, rtol=1e-5)


@pytest.mark.parametrize(("scale", "drawn"), [((1.0, 0.0, 1.0), True), ((0.0, 0.0, 0.0), False)])
def test_a_model_may_be_flattened_or_vanish(
    renderer: Renderer, scale: tuple[float, float, float], drawn: bool
) -> None:
    here = Instance(mesh=box(), material=MATTE, model=np.diag([*scale, 1.0]))
    surfaces = renderer.display(seen_from(ABOVE, here))
    assert (surfaces.depth > 0.0).any() == drawn
    np.testing.assert_allclose(surfaces.normal[MIDDLE], (0.0, float(drawn), 0.0), atol=1e-3)


def test_a_display_larger_than_textures_is_refused() -> None:
    with pytest.raises(SceneError, match=r"display_size is \(70000, 9\); want at most \d+ pixels a side"):
        Renderer((70000, 9))


def test_statistics_hold_the_samples(renderer: Renderer) -> None:
    scene = Yard().scene(4)
    truth, seen = renderer.reference(scene), renderer.display(scene)
    assert (truth.color_min <= truth.color * 1.0001).all()
    assert (truth.color <= truth.color_max * 1.0001).all()
    inside = (truth.depth_min * 0.999 <= seen.depth) & (seen.depth <= truth.depth_max * 1.001)
    assert inside.mean() > 0.998  # the centre itself is not a sample
    assert (truth.normal_spread <= 2.0 * np.sqrt(3.0) + 1e-3).all()
    smooth = unlit(replace(scene, instances=scene.instances[:1]))
    assert renderer.reference(smooth).normal_mapped_spread.max() > 0.05  # the floor has bumps...
    assert renderer.reference(smooth).normal_spread[50:].max() < 1e-3  # ...on flat ground


def test_an_edge_spreads_normals_by_their_difference(renderer: Renderer) -> None:
    camera = Camera(position=(3.0, 3.0, 0.0), target=(0.0, 0.0, 0.0), up=(0.0, 0.0, 1.0))
    here = Instance(mesh=box(), material=MATTE, model=moved(0.013, 0, 0))
    spread = renderer.reference(seen_from(camera, here)).normal_spread
    on_edge = spread[20:70, 70:90].max(axis=1)  # it runs from top to bottom
    np.testing.assert_allclose(on_edge, 2.0, atol=1e-3)  # |(1, 0, 0) - (0, 1, 0)|


def test_a_reference_rendered_in_parts_is_the_same(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = Yard().scene(2)
    whole = renderer.reference(scene)
    monkeypatch.setattr(module, "MAX_TILE", 8 * 64)
    parts = renderer.reference(scene)
    difference = np.abs(parts.color - whole.color)
    assert np.quantile(difference, 0.999) < 1e-3
    np.testing.assert_allclose(parts.depth_max, whole.depth_max, rtol=1e-3, atol=1e-4)


def test_the_same_scene_gives_the_same_bytes(renderer: Renderer) -> None:
    renderer.reference(Yard(seed=4).scene(1))  # whatever was drawn before
    (one, *others), (two, *again) = map(everything, (renderer, Renderer(renderer.display_size)))
    assert one.tobytes() == two.tobytes()
    for a, b in zip(others, again, strict=True):
        assert_same_buffers(a, b)


def assert_same_buffers(a: Any, b: Any) -> None:
    for name in type(a).__slots__:
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes(), name


def everything(renderer: Renderer) -> tuple[Any, ...]:
    """Return the colour, the surfaces of both sizes and the reference of a scene."""
    scene = Yard(seed=3).scene(5)
    color, surfaces = renderer.frame(scene, (107, 60), jitter=(0.2, -0.4))
    return color, surfaces, renderer.display(scene), renderer.reference(scene)


# --- the environment's two other forms ---


def test_a_uniform_environment_stays_uniform() -> None:
    environment = uniform(0.5)
    for level in environment.mips():
        np.testing.assert_allclose(level, 0.5, rtol=1e-5)
    normals = np.array([[1.0, 0.0, 0.0], [0.0, -0.6, 0.8]])
    np.testing.assert_allclose(harmonics(normals) @ environment.irradiance(), 0.5 * np.pi, rtol=1e-3)


def test_irradiance_comes_from_where_the_light_is() -> None:
    pixels = np.zeros((32, 64, 3), np.float32)
    pixels[:16] = 1.0  # the upper half
    irradiance = Environment(pixels=pixels).irradiance()
    up, side, down = harmonics(np.array([[0, 1.0, 0], [1.0, 0, 0], [0, -1.0, 0]])) @ irradiance
    np.testing.assert_allclose([up[0], side[0], down[0]], [np.pi, np.pi / 2, 0.0], atol=0.02)
