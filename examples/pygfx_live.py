"""Render with pygfx at half size, and upscale on the same GPU: no image passes through the CPU.

    pip install ".[gpu]" pygfx
    python examples/pygfx_live.py --frames 48 -o out/pygfx

The upscaler is an effect pass of pygfx: it reads colour and depth from pygfx's textures and encodes its
commands into pygfx's encoder. Only the camera moves, so motion is computed from depth and cameras. At the end
of each frame the enlarged render and the output are read back and written side by side.
"""

import argparse
import sys
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np
import pygfx as gfx
import wgpu
from pygfx.renderers.wgpu import EffectPass

from supersampler import Model, SupersamplerError, Upscaler, halton_jitter
from supersampler.cli.arguments import parse_size
from supersampler.conventions.encodings import srgb_decoded, srgb_encoded
from supersampler.io.display import to_uint8
from supersampler.io.images import write_png

SCALE = 2
MOTION = """
struct Camera {
    to_previous: mat4x4f,   // clip coordinates of this frame to those of the previous one, without jitter
    to_view: mat4x4f,       // clip coordinates to those of the camera
    jitter: vec2f,
    near: f32,
}

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var z_buffer: texture_depth_2d;
@group(0) @binding(2) var depth: texture_storage_2d<r32float, write>;
@group(0) @binding(3) var motion: texture_storage_2d<rgba16float, write>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(z_buffer);
    if (any(id.xy >= size)) { return; }
    let z = textureLoad(z_buffer, id.xy, 0);
    let at = (vec2f(id.xy) + 0.5 + camera.jitter) / vec2f(size);
    let clip = vec4f(2.0 * at.x - 1.0, 1.0 - 2.0 * at.y, z, 1.0);
    let view = camera.to_view * clip;
    let previous = camera.to_previous * clip;
    let moved = (previous.xy / previous.w - clip.xy) * vec2f(0.5, -0.5) * vec2f(size);
    textureStore(depth, id.xy, vec4f(select(-camera.near * view.w / view.z, 0.0, z >= 1.0), 0.0, 0.0, 0.0));
    textureStore(motion, id.xy, vec4f(moved, 0.0, 0.0));
}
"""
"""Depth and motion of a `Frame` from the z-buffer."""


def main() -> None:
    """Render and upscale the sequence."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--frames", type=int, default=48)
    parser.add_argument("--display-size", type=parse_size, default=(960, 540), help="such as 960x540")
    parser.add_argument("--model", default="classifier", help="name of a model, or its folder")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/pygfx"), help="folder for the images")
    options = parser.parse_args()
    if options.frames < 1:
        parser.error(f"--frames is {options.frames}; want at least 1")
    if any(side % SCALE for side in options.display_size):
        got = "{}x{}".format(*options.display_size)
        parser.error(f"--display-size is {got}; want multiples of {SCALE}: 1 / {SCALE} of it is rendered")
    options.output.mkdir(parents=True, exist_ok=True)

    width, height = options.display_size
    size = width // SCALE, height // SCALE
    target = gfx.Texture(dim=2, size=(*size, 1), format="rgba8unorm")
    renderer = gfx.WgpuRenderer(target, pixel_scale=1, ppaa="none")
    scene, camera = make_scene(size[0] / size[1])
    upscale = Upscale(renderer.device, options.model, camera, size, options.display_size)
    renderer.effect_passes = [upscale]
    seconds = []
    for index in range(options.frames):
        began = perf_counter()
        angle = np.radians(1.5 * index)
        camera.local.position = (6.0 * np.sin(angle), 2.0, 6.0 * np.cos(angle))
        camera.look_at((0.0, 0.6, 0.0))
        upscale.begin(halton_jitter(index, SCALE))
        renderer.render(scene, camera)
        both = [enlarged(read(renderer.device, upscale.color)), read(renderer.device, upscale.image)]
        seconds.append(perf_counter() - began)
        encoded = to_uint8(srgb_encoded(np.clip(np.concatenate(both, axis=1), 0.0, 1.0)))
        write_png(options.output / f"{index:04d}.png", encoded)
    print(f"{options.frames} images: {options.output}")
    print(f"{1000 * median(seconds):.1f} ms a frame, read back included (median)")


class Upscale(EffectPass):  # type: ignore[misc]  # pygfx has no types
    """Effect pass that upscales the frames of pygfx.

    Args:
        device: pygfx's device.
        model: name of a model, or its folder.
        camera: the scene's camera.
        size: (width, height) of the render.
        display_size: (width, height) of the image.

    Attributes:
        color: texture of the render.
        image: texture of the output.
    """

    USES_DEPTH = True
    wgsl = "@fragment fn fs_main(varyings: Varyings) -> @location(0) vec4<f32> { return vec4<f32>(); }"

    def __init__(
        self,
        device: wgpu.GPUDevice,
        model: str,
        camera: gfx.PerspectiveCamera,
        size: tuple[int, int],
        display_size: tuple[int, int],
    ) -> None:
        super().__init__()
        self._device, self._camera, self._size = device, camera, size
        self._upscaler = Upscaler(Model.load(model, executor="gpu", device=device), display_size=display_size)
        usage = wgpu.TextureUsage.STORAGE_BINDING | wgpu.TextureUsage.TEXTURE_BINDING
        self._depth, self._motion = (
            device.create_texture(size=(*size, 1), format=pixel, usage=usage)
            for pixel in ("r32float", "rgba16float")
        )
        self.image = device.create_texture(
            size=(*display_size, 1), format="rgba16float", usage=usage | wgpu.TextureUsage.COPY_SRC
        )
        module = device.create_shader_module(code=MOTION)
        self._pipeline = device.create_compute_pipeline(
            layout="auto", compute={"module": module, "entry_point": "main"}
        )
        self._matrix = self._previous = np.eye(4)
        self._is_first = True

    def begin(self, jitter: tuple[float, float]) -> None:
        """Store the camera's matrices without jitter, and shift its samples by the jitter."""
        camera, (width, height) = self._camera, self._size
        camera.clear_view_offset()
        self._projection = camera.projection_matrix
        matrix = self._projection @ camera.view_matrix
        self._previous = matrix if self._is_first else self._matrix
        self._jitter, self._matrix = jitter, matrix
        camera.set_view_offset(width, height, *jitter, width, height)

    def render(self, command_encoder: Any, color_tex: Any, depth_tex: Any, _: Any) -> None:
        """Encode depth, motion and the step."""
        self.color = color_tex.texture
        self._encode_motion(command_encoder, depth_tex)
        self._upscaler.encode_into(
            command_encoder,
            {"color": self.color, "depth": self._depth, "motion": self._motion},
            jitter=self._jitter,
            exposure=1.0,
            reset=self._is_first,
            out=self.image,
        )
        self._is_first = False

    def _encode_motion(self, encoder: wgpu.GPUCommandEncoder, z_buffer: wgpu.GPUTextureView) -> None:
        # matrices are column-major in WGSL
        matrices = [self._previous @ np.linalg.inv(self._matrix), np.linalg.inv(self._projection)]
        values = [*matrices[0].T.flat, *matrices[1].T.flat, *self._jitter, self._camera.near, 0.0]
        camera = self._device.create_buffer_with_data(
            data=np.array(values, np.float32), usage=wgpu.BufferUsage.UNIFORM
        )
        resources = {"buffer": camera}, z_buffer, self._depth.create_view(), self._motion.create_view()
        group = self._device.create_bind_group(
            layout=self._pipeline.get_bind_group_layout(0),
            entries=[{"binding": i, "resource": resource} for i, resource in enumerate(resources)],
        )
        compute = encoder.begin_compute_pass()
        compute.set_pipeline(self._pipeline)
        compute.set_bind_group(0, group)
        compute.dispatch_workgroups(-(-self._size[0] // 8), -(-self._size[1] // 8))
        compute.end()


def make_scene(aspect: float) -> tuple[gfx.Scene, gfx.PerspectiveCamera]:
    """Return a knot, a sphere and thin wires over a chequered floor."""
    scene = gfx.Scene()
    scene.add(gfx.Background.from_color("#8fb3d9"), gfx.AmbientLight("#ffffff", 0.6))
    light = gfx.DirectionalLight("#fff2dd", 2.5)
    light.local.position = (4.0, 8.0, 3.0)
    scene.add(light)
    checks = np.indices((64, 64)).sum(axis=0) % 2
    texture = gfx.Texture((70 + 150 * checks[..., None].repeat(3, 2)).astype(np.uint8), dim=2)
    floor = gfx.Mesh(
        gfx.plane_geometry(24, 24),
        gfx.MeshStandardMaterial(map=gfx.TextureMap(texture, filter="nearest"), roughness=0.9),
    )
    floor.local.rotation = (-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    floor.local.position = (0.0, -0.8, 0.0)
    knot = gfx.Mesh(
        gfx.torus_knot_geometry(0.9, 0.28, 192, 24), gfx.MeshStandardMaterial(color="#c8442e", roughness=0.35)
    )
    knot.local.position = (0.0, 0.9, 0.0)
    ball = gfx.Mesh(
        gfx.sphere_geometry(0.6, 48, 24), gfx.MeshStandardMaterial(color="#d9c36a", roughness=0.2)
    )
    ball.local.position = (2.2, -0.2, -0.6)
    scene.add(floor, knot, ball)
    for height in np.linspace(-0.4, 2.4, 8):
        line = np.array([[-3.5, height, -2.5], [3.5, height + 0.5, -2.5]], np.float32)
        scene.add(
            gfx.Line(gfx.Geometry(positions=line), gfx.LineMaterial(thickness=1.0, color="#202020", aa=False))
        )
    return scene, gfx.PerspectiveCamera(50, aspect, depth_range=(0.1, 100.0))


def read(device: wgpu.GPUDevice, texture: wgpu.GPUTexture) -> np.ndarray:
    """Return a texture's linear RGB."""
    width, height = texture.size[:2]
    half = texture.format == "rgba16float"
    pixels = device.queue.read_texture(
        {"texture": texture}, {"bytes_per_row": (8 if half else 4) * width}, (width, height, 1)
    )
    values = np.frombuffer(pixels, np.float16 if half else np.uint8).reshape(height, width, 4)[..., :3]
    return values.astype(np.float32) if half else srgb_decoded(values.astype(np.float32) / 255.0)


def enlarged(image: np.ndarray) -> np.ndarray:
    """Return an image with each pixel repeated."""
    return image.repeat(SCALE, axis=0).repeat(SCALE, axis=1)


if __name__ == "__main__":
    try:
        main()
    except SupersamplerError as error:
        sys.exit(str(error))
