"""States with every kind of content: of a still scene, with AOVs and a shaded frame."""

from functools import lru_cache
from typing import Any

import numpy as np

from noise import noise
from shared_models import shared_model
from supersampler import Frame, Model, State, Upscaler, halton_jitter

RENDER, DISPLAY = (40, 24), (80, 48)
FRAMES = 66  # two periods of jitter, after which all is frozen


@lru_cache
def loaded(method: str, executor: str) -> Model:
    return shared_model(method, executor, threads=2)


def upscaler(method: str = "taau", executor: str = "cpu", **options: Any) -> Upscaler:
    fixed: dict[str, Any] = {"validate": "off", "extrapolation": "guided-warp", **options}
    return Upscaler(loaded(method, executor), display_size=DISPLAY, **fixed)


def frame(index: int, **overrides: Any) -> Frame:
    """A frame of a scene that stands still; beyond FRAMES it moves."""
    w, h = RENDER
    gbuffer = {"base_color": np.full((h, w, 3), 0.5, np.float32), "normal": np.zeros((h, w, 3), np.float32)}
    fields: dict[str, Any] = {
        "jitter": halton_jitter(index, 2.0),
        "exposure": 1.0,
        "reset": index == 0,
        "gbuffer": gbuffer,
    }
    if index < FRAMES:
        fields["motion"] = np.zeros((h, w, 2), np.float32)
    return noise(1, RENDER, **{**fields, **overrides})


@lru_cache
def still_state(method: str = "taau", executor: str = "cpu") -> State:
    made = upscaler(method, executor)
    for index in range(FRAMES):
        made.step(frame(index))
    made.step(frame(FRAMES - 1, aovs=np.ones((*RENDER[::-1], 2), np.float32)), outputs=("aovs",))
    aovs = made.save_state().history
    assert aovs is not None
    made.reset()
    for index in range(FRAMES):
        made.step(frame(index))
    state = made.save_state()
    assert state.history is not None
    assert state.shaded is not None
    history = {**state.history, "history.aovs": aovs["history.aovs"]}
    return State(state.method, state.display_size, state.render_size, history, dict(state.shaded))
