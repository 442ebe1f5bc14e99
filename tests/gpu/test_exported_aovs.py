"""A host that reads upscaler.json blends AOVs as `step_textures` does, bit for bit."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpu_steps import DISPLAY, RENDER, moving
from supersampler import Frame, Model, Upscaler
from supersampler.io.display import usable_exposure
from supersampler_export.shaders.folder import Images, write_shader_folder
from texture_frames import STORAGE, buffer_of, buffers_of, texture_of, textures_of

FRAMES, RESET = 4, 2


class Host:
    """Runs a folder at one render size and one display size."""

    def __init__(self, device: Any, folder: Path) -> None:
        self.device, self.info = device, json.loads((folder / "upscaler.json").read_text())
        self.memory = {one["name"]: self._allocated(one, folder) for one in self.info["resources"]}
        self.pipelines = [
            device.create_compute_pipeline(
                layout="auto",
                compute={
                    "module": device.create_shader_module(code=(folder / one["file"]).read_text()),
                    "entry_point": one["entry_point"],
                },
            )
            for one in self.info["passes"]
        ]

    def size(self, rule: dict[str, Any]) -> tuple[int, int]:
        phases = 9 * DISPLAY[0] * DISPLAY[1] // (RENDER[0] * RENDER[1]) + 2
        signatures = -(-RENDER[0] // 4), -(-RENDER[1] // 4) * phases
        bases = {"one": (1, 1), "render": RENDER, "previous": RENDER, "display": DISPLAY}
        width, height = {**bases, "signatures": signatures, "previous_signatures": signatures}[rule["of"]]
        across, down = rule["multiply"]
        return -(-width // rule["divide"]) * across, -(-height // rule["divide"]) * down

    def _allocated(self, one: dict[str, Any], folder: Path) -> Any:
        width, height = self.size(one["size"])
        if one["kind"] == "texture":
            texel = one.get("format", "r32float")
            return self.device.create_texture(size=(width, height, 1), format=texel, usage=1 | 2 | 4 | 8)
        size = max(-(-one["bytes"] * width * height // 4) * 4, 16)
        buffer = self.device.create_buffer(size=size, usage=STORAGE | 64 | 4 | 8)
        if "file" in one:
            self.device.queue.write_buffer(buffer, 0, (folder / one["file"]).read_bytes())
        return buffer

    def step(self, frame: Frame, given: dict[str, Any]) -> None:
        self.memory |= given
        for before, after in self.info["history"]["pairs"]:
            self.memory[before], self.memory[after] = self.memory[after], self.memory[before]
        if frame.reset:
            self._clear()
        values = {
            "render": RENDER, "display": DISPLAY, "previous": RENDER, "jitter": frame.jitter,
            "exposure": [usable_exposure(frame.exposure) or 0.0], "adds_samples": [1], "writes_aux": [1],
            "pre_exposure": [1], "has_reactive": [0], "skips": [0],
        }  # fmt: skip
        params = np.zeros(self.info["params"]["bytes"] // 4, np.float32)
        for field in self.info["params"]["fields"]:
            params[field["offset"] // 4 :][: field["count"]] = values[field["name"]]
        self.device.queue.write_buffer(self.memory["params"], 0, params)
        encoder = self.device.create_command_encoder()
        compute = encoder.begin_compute_pass()
        for one, pipeline in zip(self.info["passes"], self.pipelines, strict=True):
            compute.set_pipeline(pipeline)
            for group in {binding["group"] for binding in one["bindings"]}:
                entries = [
                    {"binding": b["binding"], "resource": self._bound(b["resource"])}
                    for b in one["bindings"]
                    if b["group"] == group
                ]
                layout = pipeline.get_bind_group_layout(group)
                compute.set_bind_group(group, self.device.create_bind_group(layout=layout, entries=entries))
            covered = zip(self.size(one["covers"]), one["tile"], strict=True)
            compute.dispatch_workgroups(*(-(-extent // tile) for extent, tile in covered))
        compute.end()
        self.device.queue.submit([encoder.finish()])

    def _bound(self, name: str) -> Any:
        memory = self.memory[name]
        return memory.create_view() if hasattr(memory, "create_view") else {"buffer": memory}

    def _clear(self) -> None:
        described = {one["name"]: one for one in self.info["resources"]}
        for before, _ in self.info["history"]["pairs"]:
            self.memory[before] = self._allocated(described[before], Path())


def content(device: Any, memory: Any) -> bytes:
    if not hasattr(memory, "create_view"):
        return bytes(device.queue.read_buffer(memory))
    layout, size = {"bytes_per_row": 8 * memory.size[0]}, (*memory.size[:2], 1)
    return bytes(device.queue.read_texture({"texture": memory}, layout, size))


@pytest.mark.parametrize("images", ["textures", "buffers"])
@pytest.mark.parametrize("method", ["taa", "taau"])
def test_a_folder_blends_aovs_as_step_textures_does(
    device: Any, tmp_path: Path, method: str, images: Images
) -> None:
    in_textures, channels = images == "textures", 8 if images == "textures" else 5
    write_shader_folder(method, tmp_path, images=images, aovs=channels)
    host = Host(device, tmp_path)
    assert host.info["aovs"]["resources"] == (["aovs0", "aovs1"] if in_textures else ["next_aovs"])
    model = Model.load(method, executor="gpu")
    upscaler, random = Upscaler(model, display_size=DISPLAY), np.random.default_rng(1)
    for index in range(FRAMES):
        aovs = random.random((*RENDER[::-1], channels), np.float32)
        aovs[random.random(aovs.shape) < 0.1] = np.nan
        frame = replace(moving(index), aovs=aovs, reset=index in (0, RESET))
        if in_textures:
            given = textures_of(device, frame)
            of_aovs = [texture_of(device, aovs[..., i : i + 4], "rgba32float", 4) for i in (0, 4)]
            targets = [
                device.create_texture(size=(*DISPLAY, 1), format="rgba16float", usage=9) for _ in of_aovs
            ]
            image: Any = None
        else:
            given, of_aovs = buffers_of(device, frame), [buffer_of(device, aovs)]
            targets = [device.create_buffer(size=4 * channels * DISPLAY[0] * DISPLAY[1], usage=4 | 8)]
            image = device.create_buffer(size=12 * DISPLAY[0] * DISPLAY[1], usage=STORAGE | 4)
        image = upscaler.step_textures(
            given, jitter=frame.jitter, exposure=frame.exposure, reset=frame.reset, render_size=RENDER,
            out=image, aovs=of_aovs, aovs_out=targets,
        )  # fmt: skip
        bound = {f"frame_{name}": memory for name, memory in given.items()}
        host.step(frame, {**bound, **{f"frame_aovs{i}": one for i, one in enumerate(of_aovs)}})
        assert content(device, host.memory["image"]) == content(device, image)
        found = [host.memory[name] for name in host.info["aovs"]["resources"]]
        assert [content(device, one) for one in found] == [content(device, one) for one in targets]
