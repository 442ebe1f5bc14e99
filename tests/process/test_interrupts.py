"""A signal handler that raises at any instant of a step leaves a step that is whole or never began."""

import os
import signal

import pytest

from apart import STEP, run_apart

ALL = int(os.environ.get("SUPERSAMPLER_INTERRUPTS", "60"))
"""Interrupts in the whole of this file; `make fuzz` sends many more."""
METHODS = ("taa", "taau", "classifier", "classifier-small", "guided-warp")
THREADS = (1, 2, 4)

pytestmark = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="this system has no interval timer")

INTERRUPTED = """
import random, signal, sys, time
from dataclasses import replace
import numpy as np
from noise import noise
from supersampler import Upscaler

methods, threads, count = sys.argv[1].split(), int(sys.argv[2]), int(sys.argv[3])
SHAPE = (54, 96)

def gbuffer(frame):
    normal = np.zeros((*frame.depth.shape, 3), np.float32)
    normal[..., 2] = 1.0
    half = np.full(frame.depth.shape, 0.5, np.float32)
    return {"base_color": np.full_like(normal, 0.5), "normal": normal, "roughness": half, "metallic": half,
            "specular": half}

JITTER = [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)]
STILL = [noise(phase, SHAPE[::-1], jitter=JITTER[phase], exposure=1.0, reset=False) for phase in range(4)]
STILL = [replace(f, motion=np.zeros_like(f.motion), depth=STILL[0].depth) for f in STILL]

def frame_at(method, index):
    # at first all stands still, so that tiles settle and come to rest; so it does in half of the time
    frame = STILL[index % 4] if index // 40 % 2 == 0 else noise(index, SHAPE[::-1], exposure=1.0, reset=False)
    if method == "guided-warp":
        frame = replace(frame, gbuffer=gbuffer(frame), color=None if index % 3 == 2 else frame.color)
    return frame

def made(method):
    options = {"display_size": SHAPE[::-1], "threads": threads, "validate": "off"}
    if method == "guided-warp":
        return Upscaler("taau", extrapolation="guided-warp", **options)
    return Upscaler(method, **options)

def step(upscaler, frame, out=None):
    return (upscaler.extrapolate if frame.color is None else upscaler.step)(frame, out=out)

class Struck(Exception):
    pass

armed = 0

def strike(number, stack):
    global armed
    if armed:
        armed -= 1
        raise random.choice([KeyboardInterrupt, Struck])

signal.signal(signal.SIGALRM, strike)
random.seed(threads)
def shake(method):
    global armed
    calm, shaken = made(method), made(method)
    out = np.empty((*SHAPE, 3), np.float32)
    for index in range(3):
        step(calm, frame_at(method, index)), step(shaken, frame_at(method, index), out)
    began = time.perf_counter()
    expected = step(calm, frame_at(method, 3))
    typical = time.perf_counter() - began
    step(shaken, frame_at(method, 3), out)
    index, struck, done = 4, 0, 0
    while struck < count:
        frame, again = frame_at(method, index), random.random() < 0.25
        expected = step(calm, frame)
        while shaken.stats.frames <= index:
            raised = True
            try:
                delay, later = random.uniform(1e-6, 3.0 * typical), random.uniform(1e-5, typical)
                armed = 4 if again else 1
                signal.setitimer(signal.ITIMER_REAL, delay, later if again else 0.0)
                step(shaken, frame, out)
                raised = False
            except (KeyboardInterrupt, Struck):
                raised = True
            finally:
                armed = 0  # before any call: Python runs handlers at calls, and from here on none raises
                signal.setitimer(signal.ITIMER_REAL, 0.0)
            if raised:
                struck += 1
                left, image = {n: a.copy() for n, a in shaken.save_state().history.items()}, out.copy()
                time.sleep(0.5 * typical)
                assert np.array_equal(out, image), "the image changed after the step had raised"
                for name, array in shaken.save_state().history.items():
                    assert np.array_equal(array, left[name]), f"{name} changed after the raise"
            else:
                assert np.array_equal(out, expected), f"frame {index} is not what it is without interrupts"
                done += 1
        assert shaken.stats.frames == index + 1
        index += 1
    for index in range(index, index + 8):
        frame = frame_at(method, index)
        assert np.array_equal(step(calm, frame), step(shaken, frame)), index
    print(method, struck, "interrupts,", done, "whole steps between")

for method in methods:
    shake(method)
"""


@pytest.mark.parametrize("threads", THREADS)
def test_an_interrupted_step_is_whole_or_never_began(threads: int) -> None:
    count = -(-ALL // (len(METHODS) * len(THREADS)))
    arguments = f"import sys; sys.argv = ['-c', {' '.join(METHODS)!r}, '{threads}', '{count}']\n"
    run_apart(arguments + INTERRUPTED, seconds=240 + 5 * count)


def test_loading_can_be_interrupted_and_done_again() -> None:
    run_apart(f"""{STEP}
import random, signal, time
def strike(*_):
    raise KeyboardInterrupt
signal.signal(signal.SIGALRM, strike)
began = time.perf_counter()
expected = upscaler("taau").step(noise(0))
typical = time.perf_counter() - began
random.seed(1)
for _ in range({ALL}):
    try:
        try:
            signal.setitimer(signal.ITIMER_REAL, random.uniform(1e-6, typical))
            upscaler(random.choice(["taa", "taau", "classifier-small"])).step(noise(0))
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
    except KeyboardInterrupt:
        pass
    assert np.array_equal(upscaler("taau").step(noise(0)), expected)
""")
