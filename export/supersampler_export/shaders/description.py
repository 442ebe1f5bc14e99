"""Content of upscaler.json: inputs, resources and passes of a step, for hosts in any language."""

import re
from collections.abc import Iterator, Mapping, Sequence
from math import prod
from typing import Any, NamedTuple

from supersampler import __version__
from supersampler.backends.gpu.device import LIMITS
from supersampler.backends.gpu.frame import IMAGE_FORMAT, TEXTURE_CHANNELS, frame_memory
from supersampler.backends.gpu.memory import DISPLAY, RENDER, PixelBuffer, PixelMemory, PixelTexture, SizeRule
from supersampler.backends.gpu.program import ARRAYS, TEXTURES, GpuProgram, PassSpec
from supersampler.backends.gpu.shader import Binding, Shader
from supersampler.methods.aovs.gpu import aov_pass, aov_shader
from supersampler.methods.gbuffers import GBUFFERS
from supersampler.methods.model_info import ModelInfo
from supersampler_export.shaders import texts

FORMAT, VERSION = "supersampler-shaders", 3
"""Name and version of the format. The version is raised when hosts must change."""
LANGUAGE_FEATURES = {"fp32": [], "int8": ["packed_4x8_integer_dot_product"]}
"""WGSL language features by precision."""
VARIANTS = {"textures": TEXTURES, "buffers": ARRAYS}
"""Shader variants by the kind of the resources that hold frame and image."""
_CONSTANT = re.compile(r"^const (\w+) = ([^;]+);", re.MULTILINE)
_WORKGROUP = re.compile(r"@workgroup_size\(([^)]*)\)")


class ExportedPass(NamedTuple):
    """A pass with its complete shader."""

    name: str  # number and name, unique
    spec: PassSpec
    shader: Shader

    @property
    def file(self) -> str:
        """Name of the shader's file."""
        return f"{self.name}.wgsl"

    def resource(self, binding: Binding) -> str:
        """Return the name of a binding's resource."""
        return self.spec.names.get(binding.name, binding.name)


class ExportedAovs(NamedTuple):
    """AOVs that the last passes blend: channels, and textures or one buffer that hold them."""

    channels: int
    images: int

    @classmethod
    def of(cls, channels: int, images: str) -> "ExportedAovs":
        """Return AOVs of `channels` channels; in textures, rounded up to four channels each."""
        if images == "buffers":
            return cls(channels, min(channels, 1))
        textures = -(-channels // TEXTURE_CHANNELS)
        return cls(TEXTURE_CHANNELS * textures, textures)


def exported_passes(program: GpuProgram, images: str, aovs: ExportedAovs) -> list[ExportedPass]:
    """Return all passes of a step; `images`: key of VARIANTS."""
    variants, in_texture = VARIANTS[images], images == "textures"
    found = [(spec, program.shader(spec, variants)) for spec in program.passes]
    parts = aovs.images if in_texture else aovs.channels
    for number in range(aovs.images):
        spec = aov_pass(parts, number, in_texture=in_texture, has_history=True)
        found.append((spec, aov_shader(spec, variants)))
    return [
        ExportedPass(f"{number:02}_{spec.shader}", spec, shader)
        for number, (spec, shader) in enumerate(found)
    ]


def described(
    info: ModelInfo, program: GpuProgram, images: str, aovs: ExportedAovs, passes: Sequence[ExportedPass]
) -> dict[str, Any]:
    """Return the content of upscaler.json, without the digests of files; `images` is a key of VARIANTS."""
    used = {one.resource(binding): binding.kind for one in passes for binding in one.shader.bindings}
    inputs = [name for name in texts.INPUTS if f"frame_{name}" in used]
    return {
        "format": FORMAT,
        "version": VERSION,
        "method": info.method,
        "precision": program.precision,
        "target": "wgsl",
        "images": images,
        "ratios": list(info.ratios),
        "source": info.source,
        "supersampler": __version__,
        "licence": info.licence,
        "attributions": list(info.attributions),
        "requires": _requires(program, passes),
        "inputs": [
            {"name": name, "resource": f"frame_{name}", **texts.INPUTS[name]}
            | ({"formats": ["float32"]} if images == "buffers" and name not in GBUFFERS else {})
            for name in inputs
        ]
        + [
            {**texts.AOVS, "name": f"aovs{i}", "resource": f"frame_aovs{i}"}
            | {"channels": aovs.channels // aovs.images}
            | ({"formats": ["float32"]} if images == "buffers" else {})
            for i in range(aovs.images)
        ],
        "output": {
            "resource": "image",
            "layout": texts.OUTPUT_LAYOUTS[images],
            "unit": "the unit of color, including params.pre_exposure",
            "range": [0.0, 65504.0],
        },
        **({"aovs": _aovs(aovs, images)} if aovs.channels else {}),
        "params": _params(),
        "aux": {"resource": "aux", "layout": texts.AUX},
        "history": {
            "pairs": [
                [f"history_{name}", f"next_{name}"]
                for name in [*program.layout.memory("render"), *(["aovs"] if aovs.channels else [])]
            ],
            "swap": texts.SWAP,
            "reset": texts.RESET,
            "resize": texts.RESIZE,
        },
        "sizes": texts.SIZES,
        "resources": [
            one
            for one in (*_resources(program, images, aovs, used), *_aov_resources(aovs, images))
            if one["name"] in used
        ],
        "step": texts.STEP,
        "passes": [_pass(one) for one in passes],
    }


def workgroup_size(shader: Shader) -> list[int]:
    """Return the number of threads of a workgroup, (x, y, z)."""
    constants = dict(_CONSTANT.findall(shader.code))
    found = _WORKGROUP.search(shader.code)
    sides = []
    for text in found[1].split(",") if found else ():
        factors = [factor.strip() for factor in text.split("*")]
        sides.append(prod(int(constants.get(factor, factor).rstrip("u")) for factor in factors))
    return [*sides, 1, 1][:3]


def _pass(one: ExportedPass) -> dict[str, Any]:
    return {
        "name": one.name,
        "file": one.file,
        "entry_point": "main",
        "workgroup_size": workgroup_size(one.shader),
        "covers": _size(one.spec.extent),
        "tile": list(one.spec.tile),
        "bindings": [
            {
                "group": binding.group,
                "binding": binding.index,
                "resource": one.resource(binding),
                "kind": binding.kind,
                **({"format": binding.format} if binding.format else {}),
            }
            for binding in one.shader.bindings
        ],
    }


def _size(extent: SizeRule) -> dict[str, Any]:
    """Return the rule of a size. For the larger display the size may be larger than needed."""
    of, divide, (across, down) = extent
    if of == "large":  # 7/5 of the display, rounded up
        of, divide, across, down = "display", 5 * divide, 7 * across, 7 * down
    return {"of": of, "divide": divide, "multiply": [across, down]}


def _resources(
    program: GpuProgram, images: str, aovs: ExportedAovs, used: Mapping[str, str]
) -> Iterator[dict[str, Any]]:
    """Yield all resources, frame and image last; `used` has the kind of each resource's bindings."""
    yield {"name": "params", "role": "params", "kind": "uniform", **_buffer(PixelBuffer(_params()["bytes"]))}
    for name, words in program.weights.items():
        kind, memory = "uniform" if used[name] == "uniform" else "buffer", PixelBuffer(words.nbytes)
        yield {"name": name, "role": "weights", "kind": kind, **_buffer(memory), "file": f"{name}.bin"}
    histories = {"history": program.layout.memory("previous"), "next": program.layout.memory("render")}
    for role, memories in histories.items():
        for name, one in memories.items():
            yield {"name": f"{role}_{name}", "role": role, **_memory(one)}
    for name, one in program.work.items():
        yield {"name": name, "role": "work", **_memory(one)}
    role = "work" if aovs.channels else "aux"  # passes of AOVs read it
    yield {"name": "aux", "role": role, **_memory(program.outputs["aux"])}
    for name, one in frame_memory(texts.INPUTS).items():
        in_texture = images == "textures" or isinstance(one, PixelTexture)
        given = {"kind": "texture", "size": _size(one.extent)} if in_texture else _memory(one)
        yield {"name": name, "role": "frame", **given}
    image = PixelTexture(DISPLAY, IMAGE_FORMAT) if images == "textures" else program.outputs["image"]
    yield {"name": "image", "role": "image", **_memory(image)}


def _aovs(aovs: ExportedAovs, images: str) -> dict[str, Any]:
    targets = [f"aovs{i}" for i in range(aovs.images)] if images == "textures" else ["next_aovs"]
    return {"resources": targets, "layout": texts.AOV_LAYOUTS[images], "step": texts.AOV_STEP}


def _aov_resources(aovs: ExportedAovs, images: str) -> Iterator[dict[str, Any]]:
    """Yield history, images and targets of AOVs."""
    of_channels = 4 * aovs.channels
    for role in ("history", "next"):
        yield {"name": f"{role}_aovs", "role": role, **_memory(PixelBuffer(of_channels, DISPLAY))}
    for i in range(aovs.images):
        texture = {"kind": "texture", "size": _size(RENDER)}
        given = texture if images == "textures" else _memory(PixelBuffer(of_channels, RENDER))
        yield {"name": f"frame_aovs{i}", "role": "frame", **given}
        yield {"name": f"aovs{i}", "role": "aovs", **_memory(PixelTexture(DISPLAY, IMAGE_FORMAT))}


def _memory(memory: PixelMemory) -> dict[str, Any]:
    if isinstance(memory, PixelBuffer):
        return {"kind": "buffer", **_buffer(memory)}
    return {"kind": "texture", "format": memory.format, "size": _size(memory.extent)}


def _buffer(memory: PixelBuffer) -> dict[str, Any]:
    return {"size": _size(memory.extent), "bytes": memory.bytes}


def _params() -> dict[str, Any]:
    fields, offset = [], 0
    for name, count, meaning in texts.FIELDS:
        fields.append({"name": name, "offset": offset, "count": count, "meaning": meaning})
        offset += 4 * count
    return {"resource": "params", "type": "float32", "bytes": -(-offset // 16) * 16, "fields": fields}


def _requires(program: GpuProgram, passes: Sequence[ExportedPass]) -> dict[str, Any]:
    """Return the required features and limits. WebGPU's default limits suffice."""
    shaders = [one.shader for one in passes]
    threads = [workgroup_size(shader) for shader in shaders]

    def max_bindings(*kinds: str) -> int:
        return max(sum(binding.kind in kinds for binding in shader.bindings) for shader in shaders)

    return {
        "wgsl_language_features": LANGUAGE_FEATURES[program.precision],
        "features": [],
        "limits": {
            "maxStorageBuffersPerShaderStage": max_bindings("storage", "read-only-storage"),
            "maxStorageTexturesPerShaderStage": max_bindings("storage-texture"),
            "maxSampledTexturesPerShaderStage": max_bindings("texture", "uint-texture"),
            "maxComputeInvocationsPerWorkgroup": max(map(prod, threads)),
            "maxComputeWorkgroupSizeX": max(x for x, _, _ in threads),
            "maxComputeWorkgroupSizeY": max(y for _, y, _ in threads),
            "maxComputeWorkgroupStorageSize": LIMITS["max-compute-workgroup-storage-size"],
        },
    }
