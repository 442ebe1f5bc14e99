"""Throughput of a GPU: bytes per second of copies, int8 multiply-adds per second."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from supersampler.backends.gpu import memory as gpu
from supersampler_bench.timing.gpu_stopwatch import Stopwatch

if TYPE_CHECKING:
    import wgpu

COPY_SIZE = 4096, 2048
"""Texels of 16 bytes in a copy: 128 MiB, the largest binding and several times the size of caches."""
RUNS = 10
ROUNDS = 64
"""Rounds of products in each thread."""
_BUFFERS = """
@group(0) @binding(0) var<storage, read> source: array<vec4u>;
@group(0) @binding(1) var<storage, read_write> copied: array<vec4u>;
@compute @workgroup_size(16, 16)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let i = id.y * 4096u + id.x;
    copied[i] = source[i];
}
"""
_TEXTURES = """
@group(0) @binding(0) var source: texture_2d<f32>;
@group(0) @binding(1) var copied: texture_storage_2d<rgba32float, write>;
@compute @workgroup_size(16, 16)
fn main(@builtin(global_invocation_id) id: vec3u) {
    textureStore(copied, id.xy, textureLoad(source, id.xy, 0));
}
"""
_PRODUCTS = """
@group(0) @binding(0) var<storage, read_write> sums: array<vec4u>;
@compute @workgroup_size(16, 16)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let i = id.y * 4096u + id.x;
    let weights = sums[i] + vec4u(id.x, id.y, id.x ^ id.y, 0x01020304u);
    var sum = vec4i(weights.wzyx);
    for (var round = 0u; round < ROUNDSu; round++) {
        sum += vec4i(dot4I8Packed(weights.x, u32(sum.x)), dot4I8Packed(weights.y, u32(sum.y)),
                     dot4I8Packed(weights.z, u32(sum.z)), dot4I8Packed(weights.w, u32(sum.w)));
    }
    sums[i] = vec4u(sum);
}
"""


@dataclass(frozen=True)
class GpuLimits:
    """Throughput of a GPU, per second."""

    buffers: float  # bytes read and written by a shader that copies a buffer
    textures: float  # bytes read and written by a shader that copies a texture of four floats
    multiplied: float  # int8 multiply-adds by `dot4I8Packed`

    @property
    def moved(self) -> float:
        """Bytes per second of the faster copy."""
        return max(self.buffers, self.textures)

    def floor_ms(self, moved: int, multiply_adds: int) -> float:
        """Return the time to move the bytes or to multiply, whichever is longer."""
        return 1e3 * max(moved / self.moved, multiply_adds / self.multiplied)


def measure_limits(device: "wgpu.GPUDevice", *, size: tuple[int, int] = COPY_SIZE) -> GpuLimits:
    """Measure copies of `size` texels, and products, each as the fastest of RUNS runs."""
    texels = size[0] * size[1]
    buffer, texture = gpu.PixelBuffer(16, gpu.RENDER), gpu.PixelTexture(gpu.RENDER)
    noise = np.random.default_rng(0).random((size[1], size[0], 4), np.float32)  # zeros may be compressed

    def seconds(code: str, *kinds: gpu.PixelMemory) -> float:
        bound = [gpu.allocate(device, kind, size, size) for kind in kinds]
        gpu.write_to(device, bound[0], noise)
        return min(_run_seconds(device, code, [memory.resource for memory in bound], size))

    times = (
        seconds(_BUFFERS, buffer, buffer),
        seconds(_TEXTURES, texture, texture),
        seconds(_PRODUCTS.replace("ROUNDS", str(ROUNDS)), buffer),
    )
    moved = 32 * texels
    return GpuLimits(moved / times[0], moved / times[1], 16 * ROUNDS * texels / times[2])


def _run_seconds(
    device: "wgpu.GPUDevice", code: str, bound: list[Any], size: tuple[int, int]
) -> Iterator[float]:
    pipeline = device.create_compute_pipeline(
        layout="auto", compute={"module": device.create_shader_module(code=code), "entry_point": "main"}
    )
    entries = [
        {"binding": i, "resource": one if "texture_2d" in code else {"buffer": one}}
        for i, one in enumerate(bound)
    ]
    group = device.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=entries)
    watch = Stopwatch(device, 1)
    for _ in range(RUNS):
        encoder = device.create_command_encoder()
        compute = watch.timed_pass(encoder)
        compute.set_pipeline(pipeline)
        compute.set_bind_group(0, group)
        compute.dispatch_workgroups(size[0] // 16, size[1] // 16)
        compute.end()
        yield 1e-3 * float(watch.submit(encoder)[0])
