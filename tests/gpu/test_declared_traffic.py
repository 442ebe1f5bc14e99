"""Declared accesses of GPU passes, which `bench traffic` counts, match the accesses of the shaders."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest

from gbuffer_method import lit
from supersampler import Frame, Upscaler, halton_jitter
from supersampler.backends.gpu.memory import PixelMemory
from supersampler.backends.gpu.program import ARRAYS
from supersampler.methods.at_rest import phase_count
from supersampler.methods.executors import with_shaders
from supersampler.methods.gbuffers import GBUFFERS
from supersampler_bench.specs import with_default_gbuffers
from supersampler_bench.timing.traffic import UNTOUCHED, touched_fraction
from touched_elements import Recorder

RENDER, DISPLAY = (64, 32), (128, 64)
PERIOD, MAX_PERIODS = 32, 4
SPARE = 0.01
"""How much more of a resource than declared a pass may access."""


def still(index: int) -> Frame:
    shape = RENDER[::-1]
    frame = Frame(
        color=np.full((*shape, 3), 0.5, np.float32),
        depth=np.full(shape, 0.5, np.float32),
        motion=np.zeros((*shape, 2), np.float32),
        jitter=halton_jitter(index % PERIOD, 2.0),
    )
    return with_default_gbuffers(frame, GBUFFERS, DISPLAY)


class Access(NamedTuple):
    """A resource of a pass: its bytes, and the fractions that are declared and accessed."""

    name: str
    bytes: int
    declared: float
    accessed: float


def accesses(recorder: Recorder, *, frozen: bool) -> Iterator[Access]:
    program, phases = recorder.model.gpu.program, phase_count(DISPLAY, RENDER)
    memory: dict[str, PixelMemory] = program.memory()
    for spec, fractions in zip(program.passes, recorder.fractions(), strict=True):
        shader = program.shader(spec, ARRAYS)
        for binding in shader.bindings:
            if binding.name in fractions and binding.name not in UNTOUCHED:
                resource = memory[spec.names.get(binding.name, binding.name)]
                declared = touched_fraction(spec, shader, binding, phases, frozen=frozen)
                size, name = resource.total_bytes(RENDER, DISPLAY), f"{spec.title}: {binding.name}"
                yield Access(name, size, declared, fractions[binding.name])


def check(found: list[Access]) -> None:
    """Nothing is accessed that is not declared, and little is declared that is not accessed."""
    assert [one for one in found if one.accessed > one.declared + SPARE] == []
    declared = sum(one.bytes * one.declared for one in found)
    accessed = sum(one.bytes * one.accessed for one in found)
    assert 0.95 * declared <= accessed <= 1.001 * declared


@pytest.mark.parametrize("method", with_shaders())
def test_passes_access_what_they_declare_where_all_pixels_move_and_where_all_are_frozen(method: str) -> None:
    recorder = Recorder(method, RENDER, DISPLAY)
    upscaler = Upscaler(recorder.model, display_size=DISPLAY, validate="off")
    for index in range(4):
        recorder.clear()
        upscaler.step(lit(index, RENDER))
    check(list(accesses(recorder, frozen=False)))
    if not upscaler.model.info.converges:
        return
    upscaler.reset()
    for index in range(MAX_PERIODS * PERIOD):
        upscaler.step(still(index))
    assert upscaler.stats.converged == 1.0
    recorder.clear()
    upscaler.step(still(0))
    check(list(accesses(recorder, frozen=True)))
