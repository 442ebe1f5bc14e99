"""The GPU device: default limits, one compilation, and errors that say what would help."""

import gc
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from weakref import ref

import numpy as np
import pytest

from apart import run_apart
from gpu_steps import moving
from shared_models import shared_model
from supersampler import Frame, Model, Upscaler
from supersampler.backends.gpu import device as devices
from supersampler.backends.gpu.device import LIMITS, SIZES, TEXTURE_SIDE
from supersampler.backends.gpu.passes import Pass
from supersampler.backends.gpu.program import ARRAYS, TEXTURES, PassSpec
from supersampler.backends.gpu.shader import reachable_code
from supersampler.errors import ArgumentError, DeviceError
from supersampler.methods.executors import with_shaders

SDK = Path(devices.__file__).parents[2]


@pytest.fixture
def own_device(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Another device of the process for one test, which may lose it."""
    monkeypatch.setattr(devices, "_devices", [])
    return devices.default_device()


def all_passes() -> Iterator[tuple[PassSpec, Pass]]:
    for method in with_shaders():
        for variants in (ARRAYS, TEXTURES):
            executor = shared_model(method, "gpu").gpu
            yield from zip(executor.program.passes, executor.passes(variants), strict=True)


def test_passes_stay_within_webgpus_default_limits() -> None:
    for spec, one in all_passes():
        kinds = [(b.kind, b.format) for b in one.shader.bindings]
        assert sum(kind.endswith("storage") for kind, _ in kinds) <= 8, spec.shader
        assert sum(kind == "storage-texture" for kind, _ in kinds) <= 4, spec.shader
        assert sum(kind.endswith("texture") and not form for kind, form in kinds) <= 16, spec.shader
    limits = shared_model("classifier", "gpu").gpu.device.limits
    for name, value in LIMITS.items():
        assert limits[name] == value or name in SIZES, name


def flat(width: int, height: int) -> Frame:
    values = np.full((height, width, 3), 0.5, np.float32)
    motion = np.zeros((height, width, 2), np.float32)
    return Frame(color=values, depth=values[..., 0], motion=motion, jitter=(0.0, 0.0))


def test_textures_are_as_large_as_those_of_the_adapter() -> None:
    device = shared_model("taau", "gpu").gpu.device
    assert [device.limits[name] for name in SIZES] == [device.adapter.limits[name] for name in SIZES]
    if device.limits[TEXTURE_SIDE] >= 8400:
        with Upscaler("taau", scale=2.0, executor="gpu") as upscaler:
            np.testing.assert_allclose(upscaler.step(flat(4200, 2)), 0.5, rtol=1e-3)


def test_a_display_beyond_the_adapters_textures_is_refused_with_its_limit() -> None:
    limit = shared_model("taau", "gpu").gpu.device.adapter.limits[TEXTURE_SIDE]
    message = (
        rf"textures of at most {limit} pixels a side, .* want {limit + 8}x8: choose a smaller display size"
    )
    with (
        Upscaler("taau", display_size=(limit + 8, 8), executor="gpu") as upscaler,
        pytest.raises(DeviceError, match=message),
    ):
        upscaler.step(flat(limit // 2 + 4, 4))


def test_shaders_find_invalid_values_by_bit_pattern() -> None:
    for path in SDK.rglob("shaders/*.wgsl"):
        code = re.sub(r"//.*", "", path.read_text(encoding="utf-8"))
        assert not re.search(r"\b(\w+) != \1\b|isnan|isinf|isNan", code), path
    text = (SDK / "backends/gpu/shaders/sanitize.wgsl").read_text(encoding="utf-8")
    assert "bitcast<u32>" in text


def test_pipelines_are_compiled_once(monkeypatch: pytest.MonkeyPatch) -> None:
    Model.load("taau", executor="gpu")
    compiled: list[str] = []
    kind = type(devices.default_device())
    monkeypatch.setattr(kind, "create_compute_pipeline", lambda *_, **given: compiled.append(given["label"]))
    Model.load("taau", executor="gpu")
    assert compiled == []


def test_a_device_of_the_caller_is_freed_with_its_models() -> None:
    device = devices.default_device().adapter.request_device_sync()
    upscaler = Upscaler(Model.load("taa", executor="gpu", device=device), display_size=(40, 24))
    upscaler.step(moving(0))
    known = ref(device)
    del device, upscaler
    gc.collect()
    assert known() is None


def test_without_wgpu_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices, "_devices", [])
    monkeypatch.setitem(sys.modules, "wgpu", None)
    with pytest.raises(DeviceError, match=r'pip install "supersampler\[gpu\]"'):
        Upscaler("taau", scale=2.0, executor="gpu")


def test_without_an_adapter_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import wgpu

    def refuse(**_: Any) -> None:
        raise RuntimeError("no adapter")

    monkeypatch.setattr(devices, "_devices", [])
    monkeypatch.setattr(wgpu.gpu, "request_adapter_sync", refuse)
    with pytest.raises(DeviceError, match="mesa-vulkan-drivers"):
        Upscaler("taau", scale=2.0, executor="gpu")
    assert devices.adapter_text().startswith("none: ")


def test_an_adapter_below_the_limits_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    name = re.escape(
        devices.name_of(shared_model("taau", "gpu").gpu.device.adapter)
    )  # opened with the limits as they are
    monkeypatch.setattr(devices, "_devices", [])
    monkeypatch.setitem(LIMITS, "max-texture-dimension-2d", 1 << 30)
    with pytest.raises(DeviceError, match=f"{name} is below .*max-texture-dimension-2d"):
        Upscaler("taau", scale=2.0, executor="gpu")


def test_a_shader_that_does_not_compile_is_shown_with_the_adapter(monkeypatch: pytest.MonkeyPatch) -> None:
    from supersampler.backends.gpu import shader

    monkeypatch.setattr(shader, "reachable_code", lambda parts: reachable_code(parts) + "\nfn broken( {")
    with pytest.raises(DeviceError, match=r"llvmpipe|\(.*\).*compiling shaders"):
        Upscaler("taau", scale=2.0, executor="gpu")


def test_an_image_beyond_one_binding_is_refused_before_it_is_allocated() -> None:
    upscaler = Upscaler(shared_model("taau", "gpu"), display_size=(4096, 4096), validate="off")
    with pytest.raises(DeviceError, match="at most 11184810 pixels"):
        upscaler.step(moving(0, (1024, 1024), 4.0))


def test_a_lost_device_is_named_and_the_next_upscaler_has_another(own_device: Any) -> None:
    upscaler = Upscaler("taau", scale=2.0, executor="gpu", validate="off")
    first = upscaler.step(moving(0))
    own_device.destroy()
    with pytest.raises(DeviceError, match="histories on it are lost"):
        upscaler.step(moving(1))
    again = Upscaler("taau", scale=2.0, executor="gpu", validate="off")
    assert again.model.gpu.device is not own_device
    assert (again.step(moving(0)) == first).all()


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("gbuffer-small", {}),
        ("bilinear", {}),
        ("classifier", {"precision": "fp16"}),
        ("taau", {"precision": "int8"}),
    ],
)
def test_methods_without_shaders_are_refused(name: str, options: dict[str, Any]) -> None:
    with pytest.raises(ArgumentError, match=r"executor|precision"):
        Upscaler(name, scale=2.0, executor="gpu", **options)


def test_a_device_needs_the_gpu_backend() -> None:
    with pytest.raises(ArgumentError, match="device is given"):
        Model.load("taau", executor="cpu", device=devices.default_device())


FORKED = """
import os, sys
from supersampler import Upscaler, Shot
from supersampler.errors import DeviceError
frame = next(iter(Shot.open("plaza"))).frame
upscaler = Upscaler("taa", scale=2.0, executor="gpu", validate="off")
upscaler.step(frame)
child = os.fork()
if child == 0:
    try:
        upscaler.step(frame)
    except DeviceError as error:
        os._exit(0 if "forked" in str(error) else 3)
    os._exit(2)
upscaler.step(frame)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.skipif(not hasattr(__import__("os"), "fork"), reason="there is no fork here")
def test_a_forked_child_gets_an_error_and_the_parent_goes_on() -> None:
    run_apart(FORKED)
