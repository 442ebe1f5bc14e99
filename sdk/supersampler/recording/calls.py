"""What a recording holds, as records and back: how an Upscaler was made, and each call with its outcome."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import MAX_SIDE, MAX_THREADS, checked_size
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.model_file import ModelInfo
from supersampler.recording.format import Record
from supersampler.recording.outcome import Outcome, checked_image
from supersampler.recording.values import flag, members, number, text, texts, whole
from supersampler.state import State

FORMAT = 1
"""Version of the records. One that a reader does not know is refused."""
_SHADED = "shaded."  # before names of a state's arrays
_MANY = 1 << 31  # of versions


@dataclass(frozen=True, kw_only=True)
class RecordedModel:
    """Which model it was.

    Attributes:
        folder: name of the model's folder, without those it lies in.
        method: of the model.
        files: sha256 of the model's files, by name.
        config: the method's constants.
    """

    folder: str
    method: str
    files: Mapping[str, str]
    config: Mapping[str, Any]

    @staticmethod
    def of(model: ModelInfo) -> "RecordedModel":
        """Return which model this is."""
        return RecordedModel(
            folder=model.folder.name, method=model.method, files=model.files, config=model.config
        )

    def is_of(self, model: ModelInfo) -> bool:
        """Tell whether it was this model."""
        there = (self.method, dict(self.files), dict(self.config))
        return there == (model.method, dict(model.files), dict(model.config))


@dataclass(frozen=True, kw_only=True)
class Setup(RecordedModel):
    """How an Upscaler was made, of which model, and where.

    Attributes:
        contract: version of the meaning of a frame's inputs (docs/contract.md).
        extrapolation: the model that draws frames that were not shaded; None where there was none.
        executor: "onnx" or "cpu".
        precision: of what is learned, "fp32" or "int8".
        providers: of ONNX Runtime.
        threads: as asked for; 0 takes every core.
        display_size: (width, height); None where `scale` makes it of the first frame.
        scale: display over render size; not looked at beside a display size.
        skip, validate: see `Upscaler`.
        versions: of this package, Python and the packages that pictures depend on.
        machine: see `supersampler.io.machine`.
    """

    contract: int
    extrapolation: RecordedModel | None
    executor: str
    precision: str
    providers: tuple[str, ...]
    threads: int
    display_size: Size | None
    scale: float
    skip: Literal["auto", "exact"] | float
    validate: Literal["off", "warn", "strict"]
    versions: Mapping[str, str]
    machine: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class StepCall:
    """`Upscaler.step`, `extrapolate` or `step_tensors`.

    Attributes:
        index: how many steps were before it, those that were refused included.
        frame: as it was handed in, but for G-buffers that the model does not read.
        outputs: what else than the image was asked for.
        tensors: whether the frame came as tensors on a device, whose pixels nothing checks.
        extrapolated: whether its colour was to be drawn.
        outcome: what came of it; None where the process ended within the step, or just after it.
    """

    index: int
    frame: Frame
    outputs: tuple[str, ...]
    tensors: bool
    extrapolated: bool
    outcome: Outcome | None


@dataclass(frozen=True)
class ResetCall:
    """`Upscaler.reset`."""


@dataclass(frozen=True, eq=False)
class LoadStateCall:
    """`Upscaler.load_state`."""

    state: State


@dataclass(frozen=True, eq=False)
class CloseCall:
    """`Upscaler.close`. A recording without it is of a process that ended before, or that goes on.

    Attributes:
        image: (H, W, 3) the last image, whole; None where there is none.
    """

    image: Float32 | None


Call: TypeAlias = StepCall | ResetCall | LoadStateCall | CloseCall


def setup_record(setup: Setup) -> Record:
    """The first record of a file."""
    values = {f.name: getattr(setup, f.name) for f in fields(Setup)}
    values["extrapolation"] = None if setup.extrapolation is None else vars(setup.extrapolation)
    return Record("setup", {"format": FORMAT, **values})


def setup_of(record: Record) -> Setup:
    """Undo `setup_record`.

    Raises:
        KeyError, ValueError, ArgumentError: something is missing, or of a wrong type or range.
    """
    values = record.values
    size, skip, extrapolation = values["display_size"], values["skip"], values.get("extrapolation")
    return Setup(
        **_model_of(values),
        contract=whole(values["contract"], 0, _MANY),
        extrapolation=None if extrapolation is None else RecordedModel(**_model_of(members(extrapolation))),
        executor=text(values["executor"], ("onnx", "cpu")),
        precision=text(values["precision"], ("fp32", "fp16", "int8")),
        providers=texts(values["providers"], 16),
        threads=whole(values["threads"], 0, MAX_THREADS),
        display_size=None if size is None else checked_size("display_size", size),
        scale=number(values["scale"], 1.0, MAX_SIDE),
        skip=_skip(skip),
        validate=cast(
            "Literal['off', 'warn', 'strict']", text(values["validate"], ("off", "warn", "strict"))
        ),
        versions={name: text(version) for name, version in members(values["versions"]).items()},
        machine=members(values["machine"]),
    )


def _skip(value: Any) -> Literal["auto", "exact"] | float:
    if isinstance(value, str):
        return cast("Literal['auto', 'exact']", text(value, ("auto", "exact")))
    return number(value, 0.0, 1.0)


def _model_of(values: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "folder": text(values["folder"]),
        "method": text(values["method"]),
        "files": {name: text(digest) for name, digest in members(values["files"]).items()},
        "config": members(values["config"]),
    }


def step_record(
    frame: Frame, outputs: Collection[str], *, tensors: bool = False, extrapolated: bool = False
) -> Record:
    """A frame: what is no array as JSON, arrays by their field, those of a mapping as field.key."""
    values: dict[str, Any] = {}
    arrays: dict[str, NDArray[Any]] = {}
    for field in fields(frame):
        value = getattr(frame, field.name)
        if isinstance(value, np.ndarray):
            arrays[field.name] = value
        elif isinstance(value, Mapping):
            values[field.name] = {}
            arrays |= {f"{field.name}.{key}": array for key, array in value.items()}
        else:
            values[field.name] = value
    asked = {"outputs": list(map(str, outputs)), "tensors": tensors, "extrapolated": extrapolated}
    return Record("step", {"frame": values, **asked}, arrays)


def frame_of(record: Record) -> Frame:
    """Undo `step_record`.

    Raises:
        FrameError, AttributeError, KeyError, TypeError, ValueError, OverflowError: it is no frame.
    """
    inputs: dict[str, Any] = dict(members(record.values["frame"]))
    for name, array in record.arrays.items():
        outer, _, inner = name.partition(".")
        if inner:
            inputs[outer] = {**members(inputs[outer]), inner: array}
        else:
            inputs[outer] = array
    return Frame(**inputs)


def state_record(state: State) -> Record:
    """A state: its history's arrays by name, those of the last shaded frame as shaded.name."""
    values = {
        "method": state.method,
        "display_size": state.display_size,
        "render_size": state.render_size,
        "past": state.history is not None,
        "shaded": state.shaded is not None,
        "version": state.version,
    }
    shaded = {f"{_SHADED}{name}": array for name, array in (state.shaded or {}).items()}
    return Record("load_state", values, {**(state.history or {}), **shaded})


def state_of(record: Record) -> State:
    """Undo `state_record`.

    Raises:
        KeyError, ValueError, ArgumentError: it is no state. Arrays are checked by whoever loads it.
    """
    values = {"shaded": False, "version": 1, **record.values}  # which recordings that are older lack
    sizes = [(name, values[name]) for name in ("display_size", "render_size")]
    display, render = (None if size is None else checked_size(name, size) for name, size in sizes)
    history = {name: a for name, a in record.arrays.items() if not name.startswith(_SHADED)}
    shaded = {name.removeprefix(_SHADED): a for name, a in record.arrays.items() if name not in history}
    return State(
        text(values["method"]),
        display,
        render,
        history if flag(values["past"]) else None,
        shaded if flag(values["shaded"]) else None,
        whole(values["version"], 0, _MANY),
    )


def image_of(record: Record) -> Float32 | None:
    """The last image of a "close" record.

    Raises:
        ValueError: it is none.
    """
    image = record.arrays.get("image")
    return None if image is None else checked_image("image", image)
