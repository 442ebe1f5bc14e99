"""Any argument is accepted or raises a typed error, and no history changes."""

import contextlib
import math
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_

from noise import noise
from shared_models import shared_model
from supersampler import (
    Conventions,
    Frame,
    Model,
    RawFrame,
    Shot,
    SupersamplerError,
    Upscaler,
    denoise_sequence,
    halton_jitter,
    jittered_projection,
    upscale_sequence,
)
from supersampler.arguments import MAX_SIDE, MAX_THREADS, ExecutorName
from supersampler.backends.onnx.session import planes_of
from supersampler.conventions import jitter_phase_count, mip_bias, render_size_for
from supersampler.io.display import auto_exposure, display_transform
from supersampler.io.display_transforms import display_transform_from
from supersampler.io.images import write_exr
from supersampler.io.shot import ShotWriter, copy_shot, open_source
from supersampler.recording import open_recording
from supersampler.validation import detect_conventions

SIZE, DISPLAY = (32, 18), (64, 36)
GOOD = noise(1, SIZE)
UNSHADED = replace(GOOD, color=None)
TENSORS = {name: planes_of(np.asarray(getattr(GOOD, name))) for name in ("color", "depth", "motion")}
Call = Callable[[Any], object]


class Nasty:
    """Raises at every access."""

    def _raise(self, *_: object) -> Any:
        raise RuntimeError("nasty")

    __repr__ = __eq__ = __len__ = __iter__ = __float__ = __index__ = __bool__ = _raise
    __getitem__ = __dlpack__ = __array__ = __lt__ = __gt__ = __le__ = __ge__ = _raise
    __hash__ = None  # type: ignore[assignment]


class Elsewhere:
    """A path in bytes."""

    def __fspath__(self) -> bytes:
        return b"x"


def _endless() -> list[Any]:
    row: list[Any] = [1]
    row.append(row)
    return row


VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, 3, -1, MAX_THREADS + 1, 2**40, 10**400, 0.5, 1.5, 1e308, 1e-320, 1j,
    math.nan, math.inf, -math.inf, "", "x", "Auto", "64", "\0", "\ud800", "a" * 5000, b"x", b"64",
    Decimal("NaN"), Fraction(1, 3), [], [1, 2], [1.5, 2], [True, True], ["x"], [[]], (0, 4), (-1, 4),
    (2**40, 2**40), (MAX_SIDE + 1, 1), (MAX_SIDE, MAX_SIDE), ("64", "36"), (math.nan, 0), (None, None),
    (0, 0, 0), {}, {"x": 1}, {1: 2}, {"normal": None}, {1, 2}, object, len, range(2), Path("x"),
    np.float32(1.5), np.int64(3), np.bool_(True), np.complex64(1), np.str_("x"), np.datetime64("2020"),
)  # fmt: skip
DEPTH, COLOR = np.ones((18, 32), np.float32), np.ones((18, 32, 3), np.float32)
HOSTILE: list[Callable[[], Any]] = [
    *(partial(lambda given: given, value) for value in VALUES),
    lambda: 10**5000, object, Nasty, Elsewhere, lambda: (n for n in (1, 2)), lambda: (Nasty(), Nasty()),
    _endless,
    lambda: np.array(2.0), lambda: np.zeros(0, np.float32), lambda: np.ones(2), lambda: np.ones(2, bool),
    lambda: np.array(["auto", "x"]), lambda: np.full((18, 32), None),
    lambda: np.zeros((18, 32), [("r", "f4")]),
    DEPTH.copy, lambda: np.ma.masked_less(DEPTH, 2), lambda: DEPTH.astype(">f4"), lambda: DEPTH[:0],
    lambda: DEPTH.view(np.recarray), lambda: np.broadcast_to(np.float32(1), (2**20, 2**20)),
    COLOR.copy, lambda: np.ma.masked_less(COLOR, 2), lambda: COLOR.astype(np.complex64),
    lambda: COLOR.astype(np.uint8), lambda: np.broadcast_to(np.float32(1), (2**20, 2**20, 3)),
    lambda: np.ones((1, 2, 3, 1, 2, 3), np.float32), lambda: np.full((4, 4), np.nan),
]  # fmt: skip
"""Each makes a value anew."""


def _raw(**fields: Any) -> RawFrame:
    given = {"color": GOOD.color, "depth": GOOD.depth, "motion": GOOD.motion, "jitter": GOOD.jitter}
    return RawFrame(**{**given, **fields})


def _with(made: Callable[..., Any], name: str) -> Call:
    return lambda value: made(**{name: value})


STRANGE = Conventions(
    bottom_up=True, srgb=True, motion_unit="uv", motion_jittered=True, depth="linear", near=0.3
)  # fmt: skip


def _converted(name: str) -> Call:
    return lambda value: STRANGE.converter().to_frame(_raw(**{name: value}))


def _upscaler(name: str) -> Call:
    sizes: dict[str, Any] = {} if name == "scale" else {"display_size": DISPLAY}
    return lambda value: Upscaler(**{"model": shared_model("bilinear"), **sizes, name: value}).close()


def _loading(name: str) -> Call:
    """Pass an argument that is refused beside a loaded Model."""
    given: dict[str, Any] = {"display_size": DISPLAY, "executor": "onnx"}
    model = {} if name in ("model", "preset") else {"model": "bilinear"}
    return lambda value: Upscaler(**{**given, **model, name: value}).close()


FRAMES = Path("frames")
"""Folder of one frame, which `empty_folder` writes."""
WRITER: dict[str, Any] = {"path": "written", "name": "x", "display_size": None, "frame_rate": 24}
FIELDS = [*Frame.__dataclass_fields__]
LOADED = ["model", "providers", "threads", "executor", "precision", "preset"]
UNLOADED = [name for name in signature(Upscaler).parameters if name not in LOADED]
PURE: dict[str, Call] = {
    **{f"Frame({name})": _with(partial(replace, GOOD), name) for name in FIELDS},
    **{f"RawFrame({name})": _converted(name) for name in FIELDS},
    **{f"Conventions({name})": _with(Conventions, name) for name in Conventions.__dataclass_fields__},
    **{f"Upscaler({name})": _upscaler(name) for name in UNLOADED},
    **{f"Upscaler({name})": _loading(name) for name in LOADED},
    "Model.load": Model.load,
    "Upscaler.plan(render_size)": lambda value: Upscaler.plan(value, DISPLAY, "bilinear"),
    "Upscaler.plan(display_size)": lambda value: Upscaler.plan(SIZE, value, "bilinear"),
    "Upscaler.plan(model)": lambda value: Upscaler.plan(SIZE, DISPLAY, value),
    "jitter_phase_count": jitter_phase_count,
    "halton_jitter(index)": lambda value: halton_jitter(value, 2.0),
    "halton_jitter(scale)": lambda value: halton_jitter(1, value),
    "mip_bias(scale)": mip_bias,
    "mip_bias(style)": lambda value: mip_bias(2.0, value),
    "render_size_for(display_size)": lambda value: render_size_for(value, 2.0),
    "render_size_for(mode)": lambda value: render_size_for(DISPLAY, value),
    "jittered_projection(matrix)": lambda value: jittered_projection(value, (0.0, 0.0), SIZE),
    "jittered_projection(jitter)": lambda value: jittered_projection(np.eye(4), value, SIZE),
    "jittered_projection(render_size)": lambda value: jittered_projection(np.eye(4), (0.0, 0.0), value),
    "display_transform(image)": display_transform,
    "display_transform(exposure)": lambda value: display_transform(np.ones((2, 2, 3), np.float32), value),
    "auto_exposure": auto_exposure,
    "detect_conventions(shot)": detect_conventions,
    "detect_conventions(frame)": lambda value: detect_conventions([value, value]),
    "detect_conventions(frames)": lambda value: detect_conventions([_raw(), _raw()], frames=value),
    "detect_conventions(conventions)": lambda value: detect_conventions([_raw(), _raw()], conventions=value),
    "Conventions.from_json": Conventions.from_json,
    "Conventions.converter": lambda value: Conventions().converter(display_size=value),
    "Converter.to_frame": lambda value: Conventions().converter().to_frame(value),
    "Converter.from_frame": lambda value: Conventions().converter().from_frame(value),
    **{
        f"open_source({name})": _with(partial(open_source, FRAMES, conventions=Conventions()), name)
        for name in ("layout", "frames", "cuts", "jitter", "frame_rate", "display_size", "files", "reference")
    },
    "open_source(conventions)": lambda value: open_source(FRAMES, conventions=value),
    "Shot.open": Shot.open,
    "copy_shot(shot)": lambda value: copy_shot(value, "copied"),
    "copy_shot(path)": lambda value: copy_shot(Shot.open("plaza").cropped(0, 0), value),
    **{
        f"ShotWriter({name})": _with(partial(ShotWriter, **WRITER), name)
        for name in signature(ShotWriter).parameters if name != "variant"
    },
    **{
        f"denoise_sequence({name})": _with(partial(denoise_sequence, iter(()), per_frame="none"), name)
        for name in signature(denoise_sequence).parameters if name != "frames"
    },
    "upscale_sequence(scratch)": lambda value: upscale_sequence((), model="bilinear", scale=2, scratch=value),
    **{
        f"display_transform_from({name})": _with(display_transform_from, name)
        for name in signature(display_transform_from).parameters if name != "srgb"
    },
    "open_recording": open_recording,
}  # fmt: skip
"""Calls that remember nothing, by the argument that is hostile."""


def _tensors(upscaler: Upscaler, **given: Any) -> object:
    return upscaler.step_tensors(**{"tensors": TENSORS, "jitter": GOOD.jitter, **given})


SESSION: dict[str, Callable[[Upscaler, Any], object]] = {
    "step(frame)": lambda upscaler, value: upscaler.step(value),
    "step(out)": lambda upscaler, value: upscaler.step(GOOD, out=value),
    "step(outputs)": lambda upscaler, value: upscaler.step(GOOD, outputs=value),
    "step(gbuffer)": lambda upscaler, value: upscaler.step(replace(GOOD, gbuffer={"normal": value})),
    "extrapolate(frame)": lambda upscaler, value: upscaler.extrapolate(value),
    "extrapolate(want)": lambda upscaler, value: upscaler.extrapolate(UNSHADED, outputs=value),
    "step_tensors(tensors)": lambda upscaler, value: _tensors(upscaler, tensors=value),
    "step_tensors(color)": lambda upscaler, value: _tensors(upscaler, tensors={"color": value}),
    "step_tensors(jitter)": lambda upscaler, value: _tensors(upscaler, jitter=value),
    "step_tensors(exposure)": lambda upscaler, value: _tensors(upscaler, exposure=value),
    "step_tensors(reset)": lambda upscaler, value: _tensors(upscaler, reset=value),
    "step_tensors(out)": lambda upscaler, value: _tensors(upscaler, out=value),
    "load_state": lambda upscaler, value: upscaler.load_state(value),
    "warm_up": lambda upscaler, value: upscaler.warm_up(value),
}
"""Calls of an Upscaler that has a history."""


@pytest.fixture(autouse=True, scope="module")
def empty_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Some arguments are names of files to write."""
    with contextlib.chdir(tmp_path_factory.mktemp("arguments")):
        channels = ("R", "G", "B", "Z", "motion.X", "motion.Y")
        write_exr(FRAMES / "0.exr", dict.fromkeys(channels, np.ones((6, 8), np.float32)))
        yield


def refusal(call: Callable[[], object]) -> SupersamplerError | None:
    """Return the error that a call raises; None if it raises none."""
    try:
        call()
    except SupersamplerError as error:
        refused = error
    else:
        return None
    assert len(str(refused)) < (1500 if isinstance(refused, ValueError) else 12_000)  # which name files whole
    assert "\n" not in str(refused)
    return refused


@pytest.mark.parametrize("name", PURE)
def test_a_hostile_argument_is_accepted_or_raises_a_typed_error(name: str) -> None:
    for make in HOSTILE:
        refusal(lambda: PURE[name](make()))  # noqa: B023  # called at once


def _session(model: Model) -> Upscaler:
    upscaler = Upscaler(model, display_size=DISPLAY, validate="off")
    for seed in range(3):
        upscaler.step(noise(seed, SIZE))
    return upscaler


@pytest.mark.parametrize("executor", get_args(ExecutorName)[1:])
@pytest.mark.parametrize("name", SESSION)
def test_a_refused_call_changes_no_history(name: str, executor: ExecutorName) -> None:
    model = shared_model("taau", executor)
    disturbed, innocent = _session(model), _session(model)
    for make in HOSTILE:
        if refusal(lambda: SESSION[name](disturbed, make())) is None:  # noqa: B023  # called at once
            SESSION[name](innocent, make())  # it was accepted
    assert disturbed.stats.frames == innocent.stats.frames
    np.testing.assert_array_equal(disturbed.step(GOOD), innocent.step(GOOD))


@pytest.mark.parametrize("name", ["frame", "history", "outputs", "out", "history_out", "at_rest", "skip"])
def test_a_model_accepts_hostile_arguments_or_refuses_them(name: str) -> None:
    model = shared_model("taau")
    given: dict[str, Any] = {"frame": GOOD, "history": model.first_history(DISPLAY, SIZE), "outputs": ()}
    expected, _ = model.run_outputs(**given)
    for make in HOSTILE:
        refusal(lambda: model.run_outputs(**{**given, name: make()}))  # noqa: B023  # called at once
    np.testing.assert_array_equal(model.run_outputs(**given)[0].image, expected.image)


def _values() -> st.SearchStrategy[Any]:
    numbers = st.integers() | st.floats() | st.complex_numbers() | st.booleans() | st.none()
    single = numbers | st.text(max_size=8) | st.binary(max_size=8)
    kinds = arrays_.scalar_dtypes() | arrays_.array_dtypes()
    arrays = arrays_.arrays(kinds, arrays_.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4))
    nested = st.recursive(
        single,
        lambda inner: (
            st.lists(inner, max_size=3) | st.tuples(inner, inner) | st.dictionaries(single, inner, max_size=2)
        ),
        max_leaves=4,
    )
    return nested | arrays


@settings(max_examples=int(os.environ.get("SUPERSAMPLER_FUZZ", "200")))
@given(st.sampled_from(sorted(PURE)), _values())
def test_any_argument_is_accepted_or_raises_a_typed_error(name: str, value: Any) -> None:
    refusal(lambda: PURE[name](value))
