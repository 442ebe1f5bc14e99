"""`Replay`: repeats the calls of a recording and compares the outcomes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from supersampler import recording as records
from supersampler.arguments import ExecutorName, Precision
from supersampler.backends.onnx.runtime import resolve_providers
from supersampler.backends.onnx.tensors import image_of_tensor, tensors_of_frame
from supersampler.errors import ProviderError, RecordingError
from supersampler.history import StepResult
from supersampler.io.display import ExposureMeter, display_transform
from supersampler.methods import model_file
from supersampler.methods.gbuffers import values_of
from supersampler.model import Model
from supersampler.recording.recorder import raised, returned
from supersampler.upscaler import Upscaler


class ImageDifference(NamedTuple):
    """Mean, 99th percentile and maximum of absolute differences after the display transform, in [0, 1]."""

    mean: float
    p99: float
    max: float


FP32_TOLERANCE, REDUCED_TOLERANCE = ImageDifference(1e-5, 1e-3, 1.0), ImageDifference(1.0 / 255.0, 0.03, 1.0)
"""Tolerances between machines and backends: for fp32 networks, and for fp16 or int8 networks."""


@dataclass(frozen=True, eq=False)
class Replayed:
    """A replayed step, compared with the recorded one.

    Attributes:
        index: index of the step.
        result: its result; None if it raised.
        exposure: exposure at which the images are compared.
        exact: whether the results are bit-identical, or the errors the same; None if none was recorded.
        difference: difference of the recorded pixels; None if there is nothing to compare.
        within: False if the difference is beyond tolerance.
        note: errors of either run.
    """

    index: int
    result: StepResult | None = None
    exposure: float = 1.0
    exact: bool | None = None
    difference: ImageDifference | None = None
    within: bool = True
    note: str = ""


class Replay:
    """Repeats recorded calls with an Upscaler like the recorded one.

    >>> replay = Replay(open_recording("kitchen.recording"))
    >>> steps = [replay.call(call) for call in replay.recording]

    Args:
        recording: the recording.
        model: a model's name or folder; None takes the recorded one, which must ship.
        extrapolation: name or folder of the model that extrapolates unshaded frames; None as for `model`.
        executor, precision: see `Model.load`. None is the recorded value if the model is the recorded one and
            executor, precision and providers are all None; otherwise "auto".
        providers: see `Model.load`; None is the recorded providers if they are installed, else "auto".

    Attributes:
        recording: the recording.
        model: the model in use.
        is_recorded_model: whether model and extrapolation are the recorded ones.
        tolerance: tolerance for images that are not bit-identical.

    Raises:
        RecordingError: the recorded model does not ship, and no other is given.
        ModelError, ProviderError, ArgumentError: see `Model.load`.
    """

    def __init__(
        self,
        recording: records.Recording,
        *,
        model: str | Path | None = None,
        extrapolation: str | Path | None = None,
        executor: ExecutorName | None = None,
        precision: Precision | None = None,
        providers: str | Sequence[str] | None = None,
    ) -> None:
        setup, given = recording.setup, (executor, precision, providers)
        folder = _shipped(recording, setup, "--model") if model is None else model_file.find_model(model)
        if extrapolation is None and setup.extrapolation is not None:
            extrapolation = _shipped(recording, setup.extrapolation, "--extrapolate")
        pairs = [(setup, folder), (setup.extrapolation, extrapolation)]
        self.is_recorded_model = all(_is_same(recorded, used) for recorded, used in pairs)
        if providers is None:
            try:
                providers = resolve_providers(setup.providers)
            except ProviderError:
                providers = "auto"
        overridden = not self.is_recorded_model or given != (None, None, None)
        self.recording = recording
        self.model = Model.load(
            folder,
            providers=providers,
            threads=setup.threads,
            executor=(executor or "auto") if overridden else cast("ExecutorName", setup.executor),
            precision=(precision or "auto") if overridden else cast("Precision", setup.precision),
        )
        self.tolerance = (
            FP32_TOLERANCE
            if setup.precision == self.model.precision == "fp32"
            and "gpu" not in (setup.executor, self.model.executor)  # it reads samples as half floats
            else REDUCED_TOLERANCE
        )
        self._upscaler = Upscaler(
            self.model,
            display_size=setup.display_size,
            scale=setup.scale if setup.display_size is None else None,
            at_rest=setup.at_rest,
            skip=setup.skip,
            extrapolation=extrapolation,
            validate=setup.validate,
        )
        self._meter = ExposureMeter()

    def call(self, call: records.Call) -> Replayed | None:
        """Repeat a recorded call; return the comparison if it is a step.

        Raises:
            ArgumentError: a recorded state does not fit this model.

        Warns:
            FrameWarning: see `Upscaler.step`.
        """
        match call:
            case records.StepCall():
                return self._step(call)
            case records.ResetCall():
                self._upscaler.reset()
                self._meter = ExposureMeter()
            case records.LoadStateCall(state=state):
                self._upscaler.load_state(state)
        return None

    def _step(self, call: records.StepCall) -> Replayed:
        try:
            result = self._repeat(call)
        except Exception as error:  # of any type: the recorded step may have raised the same
            return _compare_errors(call, raised(error))
        frame, recorded = call.frame, call.outcome
        exposure = self._meter.read_frame(frame) / frame.pre_exposure  # images contain pre-exposure
        if recorded is None:
            return Replayed(call.index, result, exposure)
        if any(recorded.error):
            note = f"raises nothing; recorded: {_error_text(recorded)}"
            return Replayed(call.index, result, exposure, exact=False, within=False, note=note)
        here = returned(call.index, result)
        exact = here.digests == recorded.digests
        difference = ImageDifference(0.0, 0.0, 0.0) if exact else _difference(here, recorded, exposure)
        limit = self.tolerance  # single values may differ more
        within = exact or (difference.mean <= limit.mean and difference.p99 <= limit.p99)
        return Replayed(call.index, result, exposure, exact, difference, within)

    def _repeat(self, call: records.StepCall) -> StepResult:
        frame, upscaler = call.frame, self._upscaler
        if call.name == "step_tensors" and self.model.executor == "onnx":  # other backends have no tensors
            tensors = tensors_of_frame(frame, self.model.device)
            return StepResult(image_of_tensor(upscaler.step_tensors(tensors, **values_of(frame))))
        step = upscaler.extrapolate if call.name == "extrapolate" else upscaler.step
        result = step(frame, outputs=call.outputs)
        return result if isinstance(result, StepResult) else StepResult(result)


def _compare_errors(call: records.StepCall, here: records.StepOutcome) -> Replayed:
    """Compare a step that raises in the replay."""
    note = f"raises {_error_text(here)}"
    if call.outcome is None:
        return Replayed(call.index, within=False, note=note)
    kind, text = call.outcome.error
    exact = kind == here.error[0] and (kind != "FrameError" or text == here.error[1])  # other texts may vary
    note += ", as recorded" if exact else f"; recorded: {_error_text(call.outcome) if kind else 'nothing'}"
    return Replayed(call.index, exact=exact, within=exact, note=note)


def _error_text(outcome: records.StepOutcome) -> str:
    kind, text = outcome.error
    return f"{kind} ({text.rstrip('.')})"


def _difference(here: records.StepOutcome, recorded: records.StepOutcome, exposure: float) -> ImageDifference:
    """Compare the recorded pixels. AOVs are not tone-mapped; values above 1 are compared relatively."""
    differences = []
    for name in here.samples.keys() | recorded.samples.keys():
        a, b = here.samples.get(name), recorded.samples.get(name)
        if a is None or b is None or a.shape != b.shape:
            return ImageDifference(1.0, 1.0, 1.0)
        if name == "image":
            difference = display_transform(a, exposure) - display_transform(b, exposure)
        else:
            difference = (a - b) / np.maximum(1.0, np.maximum(np.abs(a), np.abs(b)))
        differences.append(np.abs(difference).ravel())
    values = np.nan_to_num(np.concatenate(differences), nan=1.0)
    return ImageDifference(float(values.mean()), float(np.quantile(values, 0.99)), float(values.max()))


def _is_same(recorded: records.RecordedModel | None, used: str | Path | None) -> bool:
    if recorded is None or used is None:
        return recorded is None and used is None
    return recorded.is_of(model_file.read_model_info(model_file.find_model(used)))


def _shipped(recording: records.Recording, model: records.RecordedModel, option: str) -> Path:
    """Return the shipped folder of a recorded model; RecordingError, which names `option`, if none ships."""
    hint = f"Pass the folder of the recorded one: {option} FOLDER."
    if model.folder not in [*model_file.model_names(), *model_file.extrapolation_names()]:
        problem = f"was recorded with the model {model.folder!r} ({model.method}), which does not ship"
        raise RecordingError(recording.path, problem, hint)
    folder = model_file.shipped_model(model.folder)
    here = model_file.read_model_info(folder)
    if not model.is_of(here):
        name = next((name for name in model.files if model.files[name] != here.files.get(name)), "model.json")
        digest, version = model.files.get(name, "")[:12], recording.setup.versions.get("supersampler")
        problem = f"was recorded with another {model.folder!r}: {name} differs (recorded sha256 {digest}...)"
        raise RecordingError(recording.path, f"{problem}, of supersampler {version}", hint)
    return folder
