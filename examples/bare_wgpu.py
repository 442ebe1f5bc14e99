"""Run exported shaders with wgpu alone: a complete host that does not import supersampler.

    supersampler export classifier --target wgsl -o out/shaders
    python examples/raw_frames.py plaza out/raw
    python examples/bare_wgpu.py out/shaders out/raw out/images

It reads everything from upscaler.json. Images are raw half floats (height, width, RGBA), linear. Work
and history textures may be larger than needed: by SPARE pixels here.
"""

import json
import struct
import sys
from pathlib import Path
from typing import Any

import wgpu

SPARE = 5
SAMPLED, STORED = wgpu.TextureUsage.TEXTURE_BINDING, wgpu.TextureUsage.STORAGE_BINDING
FORMATS = {"color": ("rgba32float", 16), "depth": ("r32float", 4), "motion": ("rg32float", 8)}


def main() -> None:
    shaders, frames, output = map(Path, sys.argv[1:])
    output.mkdir(parents=True, exist_ok=True)
    shot = json.loads((frames / "frames.json").read_text())
    device = wgpu.gpu.request_adapter_sync().request_device_sync()
    size = (*shot["display"], 1)
    usage = STORED | wgpu.TextureUsage.COPY_SRC
    image = device.create_texture(size=size, format="rgba16float", usage=usage)
    host = Host(device, shaders, shot["display"])
    for index, frame in enumerate(shot["frames"]):
        textures = {name: loaded(device, frames / frame[name], name, frame["size"]) for name in FORMATS}
        host.step(frame, {**textures, "image": image})
        pixels = device.queue.read_texture({"texture": image}, {"bytes_per_row": 8 * size[0]}, size)
        (output / f"{index:04d}.rgba16f").write_bytes(pixels)


def loaded(device: wgpu.GPUDevice, file: Path, name: str, size: list[int]) -> wgpu.GPUTexture:
    """Return an image of a frame as a texture; an engine has one already."""
    texel, bytes_ = FORMATS[name]
    usage = SAMPLED | wgpu.TextureUsage.COPY_DST
    texture = device.create_texture(size=(*size, 1), format=texel, usage=usage)
    layout = {"bytes_per_row": bytes_ * size[0], "rows_per_image": size[1]}
    device.queue.write_texture({"texture": texture}, file.read_bytes(), layout, (*size, 1))
    return texture


class Host:
    """Runs the passes, and holds the history of one view."""

    def __init__(self, device: wgpu.GPUDevice, folder: Path, display: list[int]) -> None:
        self.device, self.folder, self.display = device, folder, display
        self.about = json.loads((folder / "upscaler.json").read_text())
        self.passes = [(one, *self._compiled(one)) for one in self.about["passes"]]
        self.held: dict[str, Any] = {}  # resources of bind groups by name: weights and history
        self.previous: dict[str, Any] | None = None

    def step(self, frame: dict[str, Any], textures: dict[str, Any]) -> None:
        """Upscale a frame, and submit it."""
        pairs = self.about["history"]["pairs"]
        reset = frame["reset"] or self.previous is None
        before = frame["size"] if self.previous is None or reset else self.previous["size"]
        for history, following in pairs:
            if reset:
                self.held.pop(history, None)
            if self.previous is None or self.previous["size"] != frame["size"]:
                self.held.pop(following, None)
        sizes = bases_of(frame["size"], before, self.display)
        bound = {f"frame_{name}": texture.create_view() for name, texture in textures.items()}
        bound["image"] = textures["image"].create_view()
        for resource in self.about["resources"]:
            name = resource["name"]
            if name == "frame_reactive" and name not in bound:  # no mask: nothing reads it
                usage = SAMPLED | STORED
                bound[name] = self.device.create_texture(
                    size=(1, 1, 1), format="r32float", usage=usage
                ).create_view()
            if resource["role"] not in ("frame", "image"):
                bound[name] = self.held[name] if name in self.held else self._allocated(resource, sizes)
            if resource["role"] == "weights":
                self.held[name] = bound[name]
        self.device.queue.write_buffer(bound["params"]["buffer"], 0, self._params(frame, sizes))
        encoder = self.device.create_command_encoder()
        compute = encoder.begin_compute_pass()
        for one, pipeline, groups in self.passes:
            compute.set_pipeline(pipeline)
            for number, (layout, bindings) in enumerate(groups):
                entries = [{"binding": b["binding"], "resource": bound[b["resource"]]} for b in bindings]
                group = self.device.create_bind_group(layout=layout, entries=entries)
                compute.set_bind_group(number, group)
            covered = zip(size_of(one["covers"], sizes), one["tile"], strict=True)
            compute.dispatch_workgroups(*(-(-extent // side) for extent, side in covered))
        compute.end()
        self.device.queue.submit([encoder.finish()])
        for history, following in pairs:  # they swap: shaders write only some of the signatures
            self.held |= {history: bound[following], following: bound[history]}
        if before != frame["size"]:
            self.held = {name: held for name, held in self.held.items() if not name.startswith("next_")}
        self.previous = frame

    def _params(self, frame: dict[str, Any], sizes: dict[str, list[int]]) -> bytes:
        values = {**sizes, "jitter": frame["jitter"], "exposure": [frame["exposure"] or 0.0]}
        values |= {"writes_aux": [0.0], "adds_samples": [1.0], "pre_exposure": [1.0], "skips": [1.0]}
        values["has_reactive"] = [0.0]  # no mask: frame_reactive is not read
        params = bytearray(self.about["params"]["bytes"])
        for field in self.about["params"]["fields"]:
            struct.pack_into(f"<{field['count']}f", params, field["offset"], *values[field["name"]])
        return bytes(params)

    def _allocated(self, resource: dict[str, Any], sizes: dict[str, list[int]]) -> Any:
        """Allocate a resource of zeros, for a bind group."""
        width, height = size_of(resource["size"], sizes)
        if resource["kind"] == "texture":
            size = (width + SPARE, height + SPARE, 1)
            kind = resource["format"]
            return self.device.create_texture(size=size, format=kind, usage=SAMPLED | STORED).create_view()
        is_uniform = resource["kind"] == "uniform"
        usage = wgpu.BufferUsage.UNIFORM if is_uniform else wgpu.BufferUsage.STORAGE
        bytes_ = max(-(-resource["bytes"] * width * height // 4) * 4, 16)
        buffer = self.device.create_buffer(size=bytes_, usage=usage | wgpu.BufferUsage.COPY_DST)
        if "file" in resource:
            self.device.queue.write_buffer(buffer, 0, (self.folder / resource["file"]).read_bytes())
        return {"buffer": buffer}

    def _compiled(self, one: dict[str, Any]) -> tuple[Any, list[tuple[Any, list[Any]]]]:
        """Return the pipeline of a pass, and the layout and bindings of each group."""
        numbers = sorted({b["group"] for b in one["bindings"]})
        groups = [[b for b in one["bindings"] if b["group"] == number] for number in numbers]
        layouts = [
            self.device.create_bind_group_layout(entries=list(map(entry_of, group))) for group in groups
        ]
        module = self.device.create_shader_module(code=(self.folder / one["file"]).read_text())
        pipeline = self.device.create_compute_pipeline(
            layout=self.device.create_pipeline_layout(bind_group_layouts=layouts),
            compute={"module": module, "entry_point": one["entry_point"]},
        )
        return pipeline, list(zip(layouts, groups, strict=True))


def bases_of(render: list[int], previous: list[int], display: list[int]) -> dict[str, list[int]]:
    """Return the base sizes of the rules in upscaler.json."""
    bases = {"one": [1, 1], "render": render, "previous": previous, "display": display}
    for name, (width, height) in (("signatures", render), ("previous_signatures", previous)):
        phases = 9 * display[0] * display[1] // (width * height) + 2
        bases[name] = [-(-width // 4), -(-height // 4) * phases]
    return bases


def size_of(rule: dict[str, Any], sizes: dict[str, list[int]]) -> list[int]:
    """Return a size by its rule."""
    pairs = zip(sizes[rule["of"]], rule["multiply"], strict=True)
    return [-(-extent // rule["divide"]) * factor for extent, factor in pairs]


def entry_of(binding: dict[str, Any]) -> dict[str, Any]:
    """Return the entry of a bind group layout."""
    entry: dict[str, Any] = {"binding": binding["binding"], "visibility": wgpu.ShaderStage.COMPUTE}
    kind = binding["kind"]
    if kind == "storage-texture":
        return {**entry, "storage_texture": {"access": "write-only", "format": binding["format"]}}
    if kind.endswith("texture"):
        sampled = "uint" if kind == "uint-texture" else "unfilterable-float"
        return {**entry, "texture": {"sample_type": sampled}}
    return {**entry, "buffer": {"type": kind}}


if __name__ == "__main__":
    main()
