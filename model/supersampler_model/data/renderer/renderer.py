"""Renders scenes: jittered frames, G-buffers, and references of many samples per pixel with their statistics.

Forward shading renders all targets in one pass. The samples of a reference are rendered as one large image,
tile by tile so that it fits into memory, and averaged on the GPU.
"""

from collections.abc import Iterator, Sequence
from importlib.resources import files
from math import ceil, isqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import mip_bias
from supersampler_model.data.errors import SceneError
from supersampler_model.data.labels import PixelStatistics
from supersampler_model.data.rendered import Float16, Float32, PixelTruth, SurfaceBuffers
from supersampler_model.data.renderer import uploads
from supersampler_model.data.renderer.context import VERSION, Graphics, open_graphics
from supersampler_model.data.scenes.scene import MAX_JOINTS, MAX_POINTS, Instance, Particles, Scene

Size = tuple[int, int]
MAX_TILE = 4096  # side of a tile of a reference, samples: 0.5 GB
BLOCKS = {"View": 0, "Lights": 1, "Draw": 2, "Surface": 3, "Palettes": 4}
"""Binding points of the uniform blocks of blocks.glsl."""
SAMPLERS = {
    "base_color_map": 0, "normal_map": 1, "orm_map": 2, "emissive_map": 3,
    "environment": 4, "sun_shadow": 5, "spot_shadow": 6, "sample_colors": 0, "sample_normals": 1,
}  # fmt: skip
"""Texture units."""
Formats = tuple[tuple[int, str], ...]
"""Channels and moderngl type ("f2", "f4") of each colour texture of a target."""
_SURFACES: Formats = ((4, "f4"), (4, "f2"), (4, "f2"), (4, "f2"))
_FORMATS: dict[str, Formats] = {
    "COLOR_AND_SURFACES": (*_SURFACES, (4, "f2")),
    "SURFACES": _SURFACES,
    "SAMPLES": ((4, "f4"), (4, "f2")),
    "TRUTH": ((4, "f2"),),
}
_COLOR_AT = {"COLOR_AND_SURFACES": 4, "SAMPLES": 0}
_RESOLVED: Formats = ((4, "f4"), (4, "f4"), (4, "f4"), (1, "f4"))


class Target:
    """A framebuffer of some colour textures, with 32-bit float depth if asked for."""

    def __init__(self, graphics: Graphics, size: Size, formats: Formats, *, depth: bool) -> None:
        gl, self.size = graphics.gl, size
        self.textures = [gl.texture(size, channels, dtype=dtype) for channels, dtype in formats]
        for texture in self.textures:
            texture.filter = (gl.NEAREST, gl.NEAREST)
        self.framebuffer = gl.framebuffer(self.textures, graphics.depth_texture(size) if depth else None)

    def read(self, index: int) -> NDArray[Any]:
        """Return texture `index` as (h, w, channels), row 0 on top."""
        texture, (width, height) = self.textures[index], self.size
        return np.frombuffer(texture.read(), texture.dtype).reshape(height, width, texture.components)


class ShadowMap:
    """A depth texture that is compared when it is read: standard depth, 0 at the light."""

    def __init__(self, graphics: Graphics, size: int) -> None:
        self.texture = graphics.depth_texture((size, size))
        self.texture.compare_func = "<="
        self.texture.filter = (graphics.gl.LINEAR, graphics.gl.LINEAR)
        self.texture.repeat_x = self.texture.repeat_y = False
        self.framebuffer = graphics.gl.framebuffer((), self.texture)


class Programs(NamedTuple):
    """Shader programs for one kind of target."""

    rigid: Any
    skinned: Any
    sky: Any
    particle: Any  # None for targets without colour


def _programs(gl: Any, kind: str, *lights: str) -> Programs:
    vertex = ("blocks", "skin", "surface_vert")
    fragment = ("blocks", "material", "outputs", *(() if kind == "SURFACES" else ("lighting",)))
    particle = None
    if kind in _COLOR_AT:
        defines = (f"COLOR {_COLOR_AT[kind]}",)
        particle = _build(gl, ("blocks", "particle_vert"), ("particle_frag",), defines)
    rigid, skinned = (
        _build(gl, vertex, (*fragment, "surface_frag"), (kind, *lights, *skin)) for skin in ((), ("SKINNED",))
    )
    return Programs(
        rigid, skinned, _build(gl, ("blocks", "screen_vert"), (*fragment, "sky_frag"), (kind,)), particle
    )


def _build(gl: Any, vertex: Sequence[str], fragment: Sequence[str], defines: Sequence[str] = ()) -> Any:
    """Return the program of some shaders/*.glsl, joined in order, with blocks and samplers bound.

    The macros `defines` select a variant.
    """
    folder = files("supersampler_model.data.renderer") / "shaders"
    macros = (f"MAX_POINTS {MAX_POINTS}", f"MAX_JOINTS {MAX_JOINTS}", *defines)
    head = [f"#version {VERSION} core", *(f"#define {macro}" for macro in macros)]
    sources = ([(folder / f"{n}.glsl").read_text(encoding="utf-8") for n in ns] for ns in (vertex, fragment))
    program = gl.program(*("\n".join([*head, *texts]) for texts in sources))
    for name in program:
        if name in BLOCKS:
            program[name].binding = BLOCKS[name]
        elif name in SAMPLERS:
            program[name].value = SAMPLERS[name]
    return program


class Draws:
    """The instances of a scene on the GPU, in drawing order."""

    def __init__(self, gl: Any, assets: uploads.Assets, scene: Scene) -> None:
        self._gl, self._assets = gl, assets

        def order(instance: Instance) -> tuple[bool, float]:
            """Sort front to back, but alpha-tested surfaces last, as they delay the depth test."""
            center = instance.model @ np.append(instance.mesh.center(), 1.0)
            distance = float(np.linalg.norm(center[:3] - scene.camera.position))
            return instance.material.alpha_cutoff is not None, distance

        self._instances = tuple(sorted(scene.instances, key=order))
        skinned = [instance for instance in self._instances if instance.mesh.skin is not None]
        self._palette_of = {id(instance): index for index, instance in enumerate(skinned)}
        self._draws: Any = gl.buffer(uploads.draw_blocks(self._instances)) if self._instances else None
        self._palettes: Any = gl.buffer(uploads.palette_blocks(skinned)) if skinned else None

    def surfaces(self, rigid: Any, skinned: Any) -> None:
        """Draw all instances, with the programs for rigid and for skinned meshes."""
        for instance in self._bound():
            mirrored = np.linalg.det(instance.model[:3, :3]) < 0.0
            # The projection flips y: counter-clockwise triangles of the world are clockwise on the screen.
            self._gl.front_face = "ccw" if mirrored else "cw"
            if instance.material.double_sided:
                self._gl.disable(self._gl.CULL_FACE)
            else:
                self._gl.enable(self._gl.CULL_FACE)
            self._assets.bind_material(instance.material, BLOCKS["Surface"])
            self._assets.draw(instance.mesh, skinned if instance.mesh.skin else rigid)

    def shadows(self, rigid: Any, skinned: Any) -> None:
        """Draw both sides of all instances that cast shadows."""
        self._gl.disable(self._gl.CULL_FACE)
        for instance in self._bound():
            if instance.casts_shadow:
                self._assets.bind_material(instance.material, BLOCKS["Surface"], maps=1)
                self._assets.draw(instance.mesh, skinned if instance.mesh.skin else rigid)

    def _bound(self) -> Iterator[Instance]:
        """Yield the instances, each with its uniform blocks bound."""
        for index, instance in enumerate(self._instances):
            size = uploads.DRAW_BYTES
            self._draws.bind_to_uniform_block(BLOCKS["Draw"], index * size, size)
            if instance.mesh.skin is not None:
                size = uploads.PALETTES_BYTES
                offset = self._palette_of[id(instance)] * size
                self._palettes.bind_to_uniform_block(BLOCKS["Palettes"], offset, size)
            yield instance


class Renderer:
    """Renders scenes; use it from the thread that created it.

    >>> renderer = Renderer((640, 360))
    >>> color, surfaces = renderer.frame(scene, (320, 180), jitter=(0.25, -0.1))
    """

    def __init__(self, display_size: Size, *, samples: int = 64, graphics: Graphics | None = None) -> None:
        """Compile the shaders, in a new context or the given one.

        References of display size (width, height) have `samples` samples per pixel, on a regular grid.

        Raises:
            GraphicsError: there is no OpenGL.
            SceneError: `samples` is no usable number, or the display is larger than OpenGL's textures.
        """
        self._side = samples_side(samples)
        self.display_size = display_size
        self._graphics = graphics or open_graphics()
        self._gl = self._graphics.gl
        self._targets: dict[str, Target] = {}
        self._scene: Scene | None = None
        self._programs: dict[tuple[str, ...], Programs] = {}
        self._screens: dict[Any, Any] = {}
        with self._gl:
            largest = self._gl.info["GL_MAX_TEXTURE_SIZE"]
            if max(display_size) > largest:
                raise SceneError("display_size", got=display_size, want=f"at most {largest} pixels a side")
            self._assets = uploads.Assets(self._gl)
            self._shadow_programs = tuple(
                _build(self._gl, ("blocks", "skin", "shadow_vert"), ("material", "shadow_frag"), defines)
                for defines in ((), ("SKINNED",))
            )
            self._resolve = _build(self._gl, ("blocks", "screen_vert"), ("resolve_frag",))
            self._mean = _build(self._gl, ("blocks", "screen_vert"), ("mean_frag",))
            for program in (self._resolve, self._mean):
                program["side"].value = self._side
            self._sun_map = ShadowMap(self._graphics, uploads.SHADOW_SIZE)
            self._spot_map = ShadowMap(self._graphics, uploads.SHADOW_SIZE // 2)
            self._view = self._gl.buffer(reserve=3 * 64 + 5 * 16, dynamic=True)

    def frame(
        self, scene: Scene, render_size: Size, *, jitter: tuple[float, float]
    ) -> tuple[Float16, SurfaceBuffers]:
        """Render the input of an upscaler: colour (h, w, 3) and surfaces, at pixel centre + jitter.

        The render size (width, height) is at most the display size. Jitter (x, y) is in render pixels.
        """
        with self._gl:
            target = self._draw(scene, "COLOR_AND_SURFACES", "frame", self._frame_raster(render_size, jitter))
            return _part(target.read(4), slice(3)), _surfaces(target)

    def display(self, scene: Scene) -> SurfaceBuffers:
        """Render the surfaces at display size, at pixel centres."""
        with self._gl:
            raster = uploads.Raster.of_frame(self.display_size)
            return _surfaces(self._draw(scene, "SURFACES", "display", raster))

    def reference(self, scene: Scene) -> PixelStatistics:
        """Render the reference at display size."""
        width, height = self.display_size
        mean, low, high = (np.empty((height, width, 4), np.float32) for _ in range(3))
        spread = np.empty((height, width, 1), np.float32)
        with self._gl:
            for place, raster in self._parts():
                rendered = self._draw(scene, "SAMPLES", "samples", raster)
                part = self._resolved(rendered, self._resolve, "resolved", _RESOLVED)
                for whole, index in zip((mean, low, high, spread), range(4), strict=True):
                    whole[place] = part.read(index)
        return PixelStatistics(
            color=_part(mean, slice(3)), color_min=_part(low, slice(3)), color_max=_part(high, slice(3)),
            depth_min=_part(low, 3), depth_max=_part(high, 3),
            normal_spread=_part(spread, 0), normal_mapped_spread=_part(mean, 3),
        )  # fmt: skip

    def samples_truth(self, scene: Scene, render_size: Size, *, jitter: tuple[float, float]) -> PixelTruth:
        """Render the truth of the samples that `frame` takes."""
        raster = self._frame_raster(render_size, jitter)
        with self._gl:
            return _truth(self._draw(scene, "TRUTH", "frame_truth", raster).read(0))

    def truth(self, scene: Scene) -> PixelTruth:
        """Render the truth of the reference: the mean over its samples."""
        width, height = self.display_size
        mean = np.empty((height, width, 4), np.float16)
        with self._gl:
            for place, raster in self._parts():
                rendered = self._draw(scene, "TRUTH", "truth", raster)
                mean[place] = self._resolved(rendered, self._mean, "mean", _FORMATS["TRUTH"]).read(0)
        return _truth(mean)

    def _frame_raster(self, render_size: Size, jitter: tuple[float, float]) -> uploads.Raster:
        width, height = render_size
        ratio = (self.display_size[0] / width * self.display_size[1] / height) ** 0.5
        return uploads.Raster.of_frame(render_size, jitter, 2.0 ** mip_bias(ratio, "log2"))

    def _parts(self) -> Iterator[tuple[tuple[slice, slice], uploads.Raster]]:
        """Yield the places of the reference's tiles, and these, with a side of at most MAX_TILE samples."""
        (width, height), side = self.display_size, self._side
        most = max(MAX_TILE // side, 1)  # pixels a side; tiles are as equal as possible
        across, down = (ceil(extent / ceil(extent / most)) for extent in (width, height))
        for top in range(0, height, down):
            for left in range(0, width, across):
                w, h = min(across, width - left), min(down, height - top)
                corner, extent = (left / width, top / height), (w / width, h / height)
                raster = uploads.Raster((w * side, h * side), corner, extent, self.display_size, side)
                yield (slice(top, top + h), slice(left, left + w)), raster

    def _draw(self, scene: Scene, kind: str, role: str, raster: uploads.Raster) -> Target:
        """Draw all passes into the target of `role`."""
        self._prepare(scene)
        gl, target = self._gl, self._target(role, raster.size, _FORMATS[kind], depth=True)
        self._view.write(uploads.view_block(scene, self.display_size[0] / self.display_size[1], raster))
        self._view.bind_to_uniform_block(BLOCKS["View"])
        self._lights.bind_to_uniform_block(BLOCKS["Lights"])
        self._panorama.use(SAMPLERS["environment"])
        self._sun_map.texture.use(SAMPLERS["sun_shadow"])
        self._spot_map.texture.use(SAMPLERS["spot_shadow"])

        lights = (("SUN", scene.sun), ("SPOT", scene.spot))
        variant = (kind, *(name for name, light in lights if light is not None and kind != "SURFACES"))
        if variant not in self._programs:
            self._programs[variant] = _programs(self._gl, *variant)
        programs = self._programs[variant]
        target.framebuffer.use()
        target.framebuffer.clear(depth=0.0)
        gl.enable_only(gl.DEPTH_TEST)
        gl.depth_func = ">="  # reversed depth; the sky has depth 0, like the cleared target
        self._draws.surfaces(programs.rigid, programs.skinned)
        gl.enable_only(gl.DEPTH_TEST)
        self._screen(programs.sky)
        if kind in _COLOR_AT and self._particles is not None:
            self._draw_particles(target, programs.particle, _COLOR_AT[kind])
        return target

    def _draw_particles(self, target: Target, program: Any, attachment: int) -> None:
        gl, framebuffer = self._gl, target.framebuffer
        masks = [(False,) * 4] * len(target.textures)
        masks[attachment] = (True, True, True, False)  # alpha may be the depth
        framebuffer.color_mask, framebuffer.depth_mask = tuple(masks), False
        framebuffer.use()
        gl.enable_only(gl.DEPTH_TEST | gl.BLEND)
        gl.blend_func = gl.ONE, gl.ONE_MINUS_SRC_ALPHA
        content = [(self._particles, "4f4 4f4/i", "sphere", "particle")]
        array = gl.vertex_array(program, content, mode=gl.TRIANGLE_STRIP)
        array.render(vertices=4, instances=self._particles.size // 32)
        framebuffer.color_mask = tuple((True,) * 4 for _ in target.textures)
        framebuffer.depth_mask = True

    def _resolved(self, rendered: Target, program: Any, role: str, formats: Formats) -> Target:
        """Reduce the samples of each pixel by a program."""
        size = (rendered.size[0] // self._side, rendered.size[1] // self._side)
        target = self._target(role, size, formats, depth=False)
        target.framebuffer.use()
        self._gl.enable_only(self._gl.NOTHING)
        for texture, sampler in zip(rendered.textures, ("sample_colors", "sample_normals"), strict=False):
            texture.use(SAMPLERS[sampler])
        self._screen(program)
        return target

    def _prepare(self, scene: Scene) -> None:
        """Upload the new assets of `scene`, and draw its shadow maps."""
        if scene is self._scene:
            return
        self._scene = None  # until the whole new scene is uploaded
        self._gl.gc()  # frees the objects of earlier scenes
        self._draws = Draws(self._gl, self._assets, scene)
        self._panorama, irradiance = self._assets.environment(scene.environment)
        self._lights = self._gl.buffer(uploads.lights_block(scene, irradiance))
        particles = sorted_particles(scene.particles, scene)
        self._particles: Any = self._gl.buffer(particles.tobytes()) if len(particles) else None
        for light, shadow in ((scene.sun, self._sun_map), (scene.spot, self._spot_map)):
            if light is not None:
                self._draw_shadows(shadow, light.matrix())
        self._scene = scene

    def _draw_shadows(self, shadow: ShadowMap, matrix: Any) -> None:
        shadow.framebuffer.use()
        shadow.framebuffer.clear(depth=1.0)
        self._gl.enable_only(self._gl.DEPTH_TEST)
        self._gl.depth_func = "<="
        for program in self._shadow_programs:
            program["world_to_light"].write(uploads.columns(matrix))
        self._draws.shadows(*self._shadow_programs)

    def _target(self, role: str, size: Size, formats: tuple[tuple[int, str], ...], *, depth: bool) -> Target:
        if role not in self._targets or self._targets[role].size != size:
            self._targets[role] = Target(self._graphics, size, formats, depth=depth)
        return self._targets[role]

    def _screen(self, program: Any) -> None:
        if program not in self._screens:
            self._screens[program] = self._gl.vertex_array(program, [])
        self._screens[program].render(self._gl.TRIANGLES, vertices=3)


def samples_side(samples: int) -> int:
    """Return the samples along each side of a reference's pixel; a SceneError if there is no such grid."""
    if not 1 <= samples <= MAX_TILE**2 or isqrt(samples) ** 2 != samples:
        want = f"a square number, such as 16 or 64, up to {MAX_TILE**2}"
        raise SceneError("samples", got=samples, want=want)
    return isqrt(samples)


def sorted_particles(groups: tuple[Particles, ...], scene: Scene) -> Float32:
    """Return centre, radius and colour of all particles, (n, 8), the farthest one first."""
    if not groups:
        return np.zeros((0, 8), np.float32)
    parts = [np.concatenate([g.centers, g.radii[:, None], g.colors], axis=1) for g in groups]
    rows = np.concatenate(parts).astype(np.float32)
    along = rows[:, :3].astype(np.float64) @ scene.camera.view()[2, :3]  # backwards: the lowest is farthest
    return np.ascontiguousarray(rows[np.argsort(along, kind="stable")])


def _surfaces(target: Target) -> SurfaceBuffers:
    motion, smooth, normal, base = (target.read(index) for index in range(4))
    rgb = slice(3)
    return SurfaceBuffers(
        depth=_part(motion, 2), motion=_part(motion, slice(2)), previous_depth=_part(motion, 3),
        base_color=_part(base, rgb), normal=_part(normal, rgb), smooth_normal=_part(smooth, rgb),
        roughness=_part(normal, 3), metallic=_part(base, 3), specular=_part(smooth, 3),
    )  # fmt: skip


def _truth(image: Float16) -> PixelTruth:
    still, moving, others, light = (_part(image, index) for index in range(4))
    return PixelTruth(thin_still=still, thin_moving=moving, moving=others, unshadowed=light)


def _part(image: Any, channels: slice | int) -> Any:
    """Copy channels of (h, w, c) into an array of their own."""
    return np.ascontiguousarray(image[..., channels])
