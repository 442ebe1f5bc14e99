"""Histories and outputs of the GPU backend: saved, loaded, converging, shared, and of bounded memory."""

import gc
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from weakref import WeakSet

import numpy as np
import pytest

from gpu_steps import METHODS, RENDER, TOLERANCES, distance, make, moving
from method_lists import WITH_SHADERS
from noise import Size
from shared_models import shared_model
from supersampler.arguments import ExecutorName
from supersampler.backends.gpu.executor import GpuExecutor
from supersampler.backends.gpu.memory import TEXELS, write_to
from supersampler.backends.gpu.passes import MAX_GROUPS
from supersampler.recording import open_recording
from supersampler.recording.replay import Replay

MAPS = {"taa": ["weight"], "taau": ["weight", "count", "converged"]}
ALL_MAPS = ["class_map", "weight", "count", "converged"]
MAX_GROWTH = 8 << 20


@pytest.mark.parametrize("method", WITH_SHADERS)
@pytest.mark.parametrize(
    ("first", "second"), [("gpu", "gpu"), ("cpu", "gpu"), ("gpu", "cpu"), ("onnx", "gpu")]
)
def test_a_state_passes_from_one_backend_to_another(method: str, first: str, second: str) -> None:
    before, after, whole = make(method, first), make(method, second), make(method, second)
    for index in range(4):
        before.step(moving(index))
        whole.step(moving(index))
    after.load_state(before.save_state())
    most = 2 * TOLERANCES[method] * (first != second) + 1e-3 * (first == "onnx")
    for index in range(4, 7):
        assert distance(after.step(moving(index)), whole.step(moving(index))) <= most


@pytest.mark.parametrize(("render", "display"), [((1, 1), (9, 9)), ((4, 4), (21, 21))])
def test_a_state_of_tiny_frames_at_the_largest_ratio_passes_between_backends(
    render: Size, display: Size
) -> None:
    ours, theirs = make("taau", display=display), make("taau", "cpu", display)
    for index in range(3):
        ours.step(moving(index, render))
    theirs.load_state(ours.save_state())
    ours.load_state(theirs.save_state())
    one, other = (upscaler.save_state().history or {} for upscaler in (ours, theirs))
    np.testing.assert_array_equal(one["history.phases"], other["history.phases"])


@pytest.mark.parametrize("method", WITH_SHADERS)
def test_outputs_beside_the_image_are_those_of_the_cpu(method: str) -> None:
    names = MAPS.get(method, ALL_MAPS)
    ours, theirs = make(method), make(method, "cpu")
    for index in range(4):
        found, wanted = (u.step(moving(index), outputs=names) for u in (ours, theirs))
        for name in names:
            mine, cpu = getattr(found, name), getattr(wanted, name)
            assert mine.shape == cpu.shape
            assert np.abs(mine - cpu).mean() <= 0.02 * max(1.0, np.abs(cpu).max()), name


def test_a_recording_replays_bit_for_bit_and_on_other_backends(tmp_path: Path) -> None:
    with make("taau", record=tmp_path / "recording") as upscaler:
        for index in range(3):
            upscaler.step(moving(index))
    recording = open_recording(tmp_path / "recording")
    executors: tuple[ExecutorName | None, ...] = (None, "cpu")
    for executor in executors:
        replay = Replay(recording, executor=executor)
        found = [replay.call(call) for call in recording]
        steps = [step for step in found if step is not None]
        assert len(steps) == 3
        assert all(step.within for step in steps)
        assert all(step.exact for step in steps) == (executor is None)


@pytest.mark.parametrize("method", ["taau", "classifier-small"])
def test_upscalers_on_one_device_do_not_disturb_each_other(method: str) -> None:
    upscaler = make(method)
    alone = [upscaler.step(moving(index)) for index in range(6)]
    one, two = make(method), make(method, display=(30, 18))
    for index in range(6):
        np.testing.assert_array_equal(one.step(moving(index)), alone[index])
        two.step(moving(index))

    def run(_: int) -> list[Any]:
        own = make(method)
        return [own.step(moving(index)) for index in range(6)]

    for found in ThreadPoolExecutor(2).map(run, range(4)):
        for image, wanted in zip(found, alone, strict=True):
            np.testing.assert_array_equal(image, wanted)


@pytest.mark.parametrize("sizes", [[RENDER], [(20 + index % 7, 12 + index % 5) for index in range(35)]])
def test_memory_and_bind_groups_do_not_grow_with_the_number_of_steps(sizes: list[Size]) -> None:
    upscaler = make("taau")

    def run(count: int) -> int:
        for index in range(count):
            upscaler.step(moving(index % 8, sizes[index % len(sizes)]))
        gc.collect()
        return resident()

    before = run(150)
    assert run(400) - before <= MAX_GROWTH
    history = upscaler._camera.history
    assert history is not None
    [groups] = history.buffers.groups.values()
    assert max(map(len, groups.values())) <= MAX_GROUPS


@pytest.mark.parametrize("is_closed", [True, False])
def test_the_memory_of_a_history_is_freed_with_it(is_closed: bool) -> None:
    upscaler, memory = make("taau"), WeakSet[Any]()
    for index in range(4):
        upscaler.step(moving(index))
        history = upscaler._camera.history
        assert history is not None
        memory.update(one.resource for one in history.buffers.memory.values())
    del history
    if is_closed:
        upscaler.close()
    else:  # frames of another size have other histories
        for index in range(3):
            upscaler.step(moving(index, (RENDER[0] + 1, RENDER[1])))
    gc.collect()
    assert len(memory) == 0


def resident() -> int:
    """Bytes of this process in memory."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * 4096


def spoil(executor: GpuExecutor) -> None:
    """Fill the memory between passes with values that no pass writes."""
    for space in executor._buffers.values():
        for memory in (space.memory[name] for name in executor.program.work):
            shape: tuple[int, ...] = (memory.resource.size // 4,) if memory.texture is None else ()
            if memory.texture is not None:
                width, height = memory.texture.size[:2]
                shape = height, width, TEXELS[memory.texture.format] // 4
            write_to(executor.device, memory, np.full(shape, 0x7F7F7F7F, np.uint32))


@pytest.mark.parametrize("method", METHODS)
def test_a_step_reads_no_stale_intermediate_data(method: str) -> None:
    upscaler, other = make(method), make(method)
    images = [upscaler.step(moving(index)).copy() for index in range(3)]
    for index, image in enumerate(images):
        spoil(shared_model(method, "gpu").gpu)
        np.testing.assert_array_equal(other.step(moving(index)), image)
