"""`Replay`: makes the calls of a recording again and compares the outcomes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from supersampler.backends.onnx.providers import resolve_providers
from supersampler.backends.onnx.tensors import image_of_tensor, tensors_of_frame
from supersampler.errors import ProviderError, RecordingError
from supersampler.history import StepResult
from supersampler.io.display import ExposureMeter, display_transform
from supersampler.methods.model_file import (
    extrapolation_names,
    find_model,
    model_names,
    read_model_info,
    shipped_model,
)
from supersampler.model import ExecutorName, Model, Precision
from supersampler.recording.calls import Call, LoadStateCall, ResetCall, StepCall
from supersampler.recording.outcome import Outcome, raised, returned
from supersampler.recording.recording import Recording
from supersampler.recording.setup import RecordedModel
from supersampler.upscaler import Upscaler


@dataclass(frozen=True)
class Difference:
    """Differences between images as a screen shows them, in [0, 1], over all values.

    Attributes:
        mean: of the absolute differences.
        most: their 99th percentile.
        largest: of them.
    """

    mean: float
    most: float
    largest: float

    def is_within(self, tolerance: "Difference") -> bool:
        """Tell whether mean and 99th percentile are; single values may differ more, where a class flips."""
        return self.mean <= tolerance.mean and self.most <= tolerance.most


SINGLE, LESS = Difference(1e-5, 1e-3, 1.0), Difference(1.0 / 255.0, 0.03, 1.0)
"""Tolerated between machines and executors: with fp32 networks; with fp16 or int8 ones."""
_NOTHING, _ALL = Difference(0.0, 0.0, 0.0), Difference(1.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class Replayed:
    """A step that was replayed, beside the recorded one.

    Attributes:
        index: of the step.
        result: what it returned; None where it raised.
        exposure: with which images are compared.
        exact: whether it returned the same bits, or raised the same; None where no outcome was recorded.
        difference: of the recorded pixels; None where there is nothing to compare.
        within: False where it is known to be beyond tolerance.
        note: errors, of either run.
    """

    index: int
    result: StepResult | None = None
    exposure: float = 1.0
    exact: bool | None = None
    difference: Difference | None = None
    within: bool = True
    note: str = ""


class Replay:
    """An Upscaler made as the recorded one, and its calls.

    >>> replay = Replay(open_recording("kitchen.recording"))
    >>> steps = [replay.call(call) for call in replay.recording]

    Args:
        recording: the recording.
        model: a model's name or folder; None takes the recorded one, if it ships.
        extrapolation: likewise, of the model that extrapolates unshaded frames.
        executor: see `Model.load`. With the recorded model, and none of executor, precision and providers
            given, the recorded ones are taken; otherwise "auto" stands in for what is not given.
        precision: see `Model.load`.
        providers: see `Model.load`; None takes the recorded ones where they are installed, else "auto".

    Attributes:
        recording: the recording.
        model: in use.
        is_recorded_model: whether model and extrapolation are the recorded ones.
        tolerance: for images that are not bit for bit the same.

    Raises:
        RecordingError: the recorded model does not ship, and none is given.
        ModelError, ProviderError, ArgumentError: see `Model.load`.
    """

    def __init__(
        self,
        recording: Recording,
        *,
        model: str | Path | None = None,
        extrapolation: str | Path | None = None,
        executor: ExecutorName | None = None,
        precision: Precision | None = None,
        providers: str | Sequence[str] | None = None,
    ) -> None:
        setup, given = recording.setup, (executor, precision, providers)
        folder = _recorded_model(recording, setup, "--model") if model is None else find_model(model)
        if extrapolation is None and setup.extrapolation is not None:
            extrapolation = _recorded_model(recording, setup.extrapolation, "--extrapolation")
        pairs = [(setup, folder), (setup.extrapolation, extrapolation)]
        self.is_recorded_model = all(_is_same(recorded, used) for recorded, used in pairs)
        if providers is None:
            try:
                providers = resolve_providers(setup.providers)
            except ProviderError:
                providers = "auto"
        asked = not self.is_recorded_model or given != (None, None, None)
        self.recording = recording
        self.model = Model.load(
            folder,
            providers=providers,
            threads=setup.threads,
            executor=(executor or "auto") if asked else cast("ExecutorName", setup.executor),
            precision=(precision or "auto") if asked else cast("Precision", setup.precision),
        )
        self.tolerance = SINGLE if setup.precision == self.model.precision == "fp32" else LESS
        self._upscaler = Upscaler(
            self.model,
            display_size=setup.display_size,
            scale=setup.scale if setup.display_size is None else None,
            skip=setup.skip,
            extrapolation=extrapolation,
            validate=setup.validate,
        )
        self._meter = ExposureMeter()

    def call(self, call: Call) -> Replayed | None:
        """Make a recorded call; return the outcome of a step.

        Raises:
            ArgumentError: a recorded state does not fit this model.

        Warns:
            FrameWarning: as the recorded Upscaler did.
        """
        match call:
            case StepCall():
                return self._step(call)
            case ResetCall():
                self._upscaler.reset()
                self._meter = ExposureMeter()
            case LoadStateCall(state):
                self._upscaler.load_state(state)
        return None

    def _step(self, call: StepCall) -> Replayed:
        try:
            result = self._made(call)
        except Exception as error:  # of any type: the recorded step may have raised the same
            return _refused(call, raised(error))
        frame, recorded = call.frame, call.outcome
        exposure = self._meter.read(frame.color, given=frame.exposure, reset=frame.reset)
        if recorded is None:
            return Replayed(call.index, result, exposure)
        if any(recorded.error):
            note = f"raises nothing; recorded: {_text(recorded)}"
            return Replayed(call.index, result, exposure, exact=False, within=False, note=note)
        here = returned(call.index, result)
        exact = here.digests == recorded.digests
        difference = _NOTHING if exact else _difference(here, recorded, exposure)
        within = exact or difference.is_within(self.tolerance)
        return Replayed(call.index, result, exposure, exact, difference, within)

    def _made(self, call: StepCall) -> StepResult:
        frame, upscaler = call.frame, self._upscaler
        if call.tensors and self.model.executor == "onnx":  # the CPU backend takes no tensors
            tensors = tensors_of_frame(frame, self.model.device)
            image = upscaler.step_tensors(
                tensors, jitter=frame.jitter, exposure=frame.exposure, reset=frame.reset
            )
            return StepResult(image_of_tensor(image))
        step = upscaler.extrapolate if call.extrapolated else upscaler.step
        made = step(frame, outputs=call.outputs)
        return made if isinstance(made, StepResult) else StepResult(made)


def _refused(call: StepCall, here: Outcome) -> Replayed:
    """Return the comparison of a step that raised in the replay."""
    recorded, exact = call.outcome, None
    note = f"raises {_text(here)}"
    if recorded is not None:
        kind, text = recorded.error
        exact = kind == here.error[0] and (kind != "FrameError" or text == here.error[1])  # ours say the same
        note += ", as recorded" if exact else f"; recorded: {_text(recorded) if kind else 'nothing'}"
    return Replayed(call.index, exact=exact, within=exact is True, note=note)


def _text(outcome: Outcome) -> str:
    kind, text = outcome.error
    return f"{kind} ({text.rstrip('.')})"


def _difference(here: Outcome, recorded: Outcome, exposure: float) -> Difference:
    """Compare the pixels that were kept. AOVs are no light: their difference is relative above 1."""
    shapes = [{name: pixels.shape for name, pixels in o.samples.items()} for o in (here, recorded)]
    if shapes[0] != shapes[1]:
        return _ALL
    differences = []
    for name, pixels in here.samples.items():
        other = recorded.samples[name]
        if name == "image":
            difference = display_transform(pixels, exposure) - display_transform(other, exposure)
        else:
            difference = (pixels - other) / np.maximum(1.0, np.maximum(np.abs(pixels), np.abs(other)))
        differences.append(np.abs(difference).ravel())
    values = np.nan_to_num(np.concatenate(differences), nan=1.0)
    return Difference(float(values.mean()), float(np.quantile(values, 0.99)), float(values.max()))


def _is_same(recorded: RecordedModel | None, used: str | Path | None) -> bool:
    if recorded is None or used is None:
        return recorded is None and used is None
    return recorded.is_of(read_model_info(find_model(used)))


def _recorded_model(recording: Recording, model: RecordedModel, option: str) -> Path:
    """Return the folder of a recorded model among those that ship; `option` gives another.

    Raises:
        RecordingError: it is not among them.
    """
    hint = f"Give the recorded one's folder: {option} FOLDER."
    if model.folder not in [*model_names(), *extrapolation_names()]:
        problem = f"was recorded with the model {model.folder!r} ({model.method}), which does not ship"
        raise RecordingError(recording.path, problem, hint)
    folder = shipped_model(model.folder)
    here = read_model_info(folder)
    if not model.is_of(here):
        name = next((name for name in model.files if model.files[name] != here.files.get(name)), "model.json")
        digest, version = model.files.get(name, "")[:12], recording.setup.versions.get("supersampler")
        problem = f"was recorded with another {model.folder!r}: {name} differs (recorded sha256 {digest}...)"
        raise RecordingError(recording.path, f"{problem}, of supersampler {version}", hint)
    return folder
