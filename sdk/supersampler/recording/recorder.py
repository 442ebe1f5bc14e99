"""`Recorder`: writes each call of an Upscaler and its outcome to a folder."""

import json
import math
import os
import re
import weakref
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from functools import partial
from io import FileIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.onnx.tensors import Tensor, frame_of_tensors, image_of_tensor
from supersampler.conventions import Conventions
from supersampler.errors import ArgumentError, RecordingError, ShotError
from supersampler.frame import Float32, Frame
from supersampler.history import State, StepResult
from supersampler.io.files import (
    NO_ROOM,
    is_own_folder,
    is_regular,
    is_there,
    new_file,
    remove_empty_folders,
    remove_files,
    write_text,
)
from supersampler.io.images import write_exr
from supersampler.io.machine import machine
from supersampler.io.shot.format import (
    COLOR,
    FILE_NAME,
    FrameEntry,
    ShotInfo,
    aov_channels,
    entry_json,
    files_of,
    shot_json,
    write_frame,
)
from supersampler.io.shot.safetensors import write_safetensors
from supersampler.methods.gbuffers import only_gbuffers
from supersampler.methods.model_file import sha256
from supersampler.methods.model_info import ModelInfo
from supersampler.recording import (
    CALLS,
    DISPLAY,
    FORMAT,
    FRAME,
    LAST_IMAGE,
    SAMPLED,
    SETUP,
    SHADED,
    STATE,
    RecordedModel,
    Setup,
    StepOutcome,
    versions,
)

if TYPE_CHECKING:
    from supersampler.model import Model

SAMPLES = 4096
"""Approximate number of pixels of each image that are kept."""
_FOLDERS = ("display", "sampled", "states")
_FILES = re.compile(
    r"((display|sampled)/)?\d{4,}\.exr|states/\d{4,}\.safetensors|last\.exr|(recording|shot)\.json|calls\.jsonl"
    r"|((display|sampled|states)/)?\.\w+\.[0-9a-f]{8}\.partial\.\w+"  # of a killed process; see `io.files`
)


class Recorder:
    """Appends each call of an Upscaler to a log before it is made, and its outcome after it.

    Where the disk refuses, the call raises before it is made, and the recording ends with the previous call.
    Later calls are not recorded.

    Args:
        path: the folder, which must not exist.
        model: the Upscaler's model.
        extrapolation: the models that extrapolate unshaded frames, at most one.
        inputs: names of the tensors that the models read; other G-buffers are not recorded.
        settings: the Upscaler's display_size, scale, at_rest, skip and validate.

    Raises:
        RecordingError: the folder exists, or cannot be written.
    """

    def __init__(
        self,
        path: Path | str,
        model: "Model",
        extrapolation: Sequence[ModelInfo],
        inputs: Collection[str],
        **settings: Any,
    ) -> None:
        self.path, self._inputs = Path(path), inputs
        self._failure: OSError | None = None
        self._entries: list[FrameEntry] = []  # entries in shot.json
        self._steps = self._states = 0
        self._last: Float32 | None = None
        self._log: FileIO | None = None
        setup = Setup(
            **vars(RecordedModel.of(model.info)),
            extrapolation=next(map(RecordedModel.of, extrapolation), None),
            executor=model.executor,
            precision=model.precision,
            providers=tuple(model.providers),
            threads=model.threads,
            versions=versions(),
            machine=machine(),
            **settings,
        )
        with self._transaction():
            try:
                self.path.mkdir(parents=True)
            except FileExistsError:
                hint = "Choose another name, or move it away."
                raise RecordingError(path, "is there already", hint) from None
            write_text(self.path / SETUP, json.dumps({"format": FORMAT, **asdict(setup)}, indent=1) + "\n")
            self._log = new_file(self.path / CALLS)  # unbuffered: each line is in the file at once
            self._close_log = weakref.finalize(self, self._log.close)  # no ResourceWarning without `close`

    @contextmanager
    def step(self, name: str, frame: Frame, outputs: Sequence[str]) -> Iterator[list[Any]]:
        """Record the step of a `with` block, which appends its result, a StepResult or tensor, to the list.

        The frame is written before the block, so that the recording has it if the process ends in the step.
        A step that raises ArgumentError or KeyboardInterrupt is removed from the recording.

        Args:
            name: name of the Upscaler's method.
            frame: its frame.
            outputs: names of the auxiliary outputs.

        Raises:
            RecordingError: the call, or the previous outcome, cannot be written; the block was not run.
        """
        results: list[Any] = []
        if not self._is_on():
            yield results
            return
        frame = replace(only_gbuffers(frame, self._inputs))  # checks G-buffers again
        index, start = self._steps, self._log_end()
        entry = FrameEntry(
            file=FRAME.format(index),
            jitter=frame.jitter,
            reset=frame.reset,
            exposure=frame.exposure,
            pre_exposure=frame.pre_exposure,
            display_file=DISPLAY.format(index) if frame.gbuffer_display else None,
            render_size=frame.size,
            shaded=frame.color is not None,
        )
        files, sampled = files_of(entry), SAMPLED.format(index)
        undo = partial(self._cut, start, (*files, sampled))
        with self._transaction(undo):
            write_frame(self.path, entry, Conventions().converter().from_frame(frame), "none")
            self._append({"call": name, "outputs": outputs, "frame": entry_json(entry)}, files)
        self._steps += 1  # after any interruption the next step has its own files
        try:
            yield results
        except BaseException as error:
            if isinstance(error, ArgumentError) or not isinstance(error, Exception):
                undo()
                self._steps -= 1
            else:
                with self._transaction(undo, raises=False):
                    self._append({"raised": raised(error).error})
            raise
        [made] = results
        result = made if isinstance(made, StepResult) else StepResult(image_of_tensor(made))
        with self._transaction(undo, raises=False):
            outcome = returned(index, result)
            _write_samples(self.path / sampled, outcome)
            self._append({"returned": outcome.digests}, [sampled])
            self._list_in_shot(entry, result.image)
        if self._last is None or self._last.shape != result.image.shape:
            self._last = np.empty_like(result.image)
        np.copyto(self._last, result.image)

    @contextmanager
    def step_tensors(
        self,
        tensors: Mapping[str, Tensor],
        jitter: tuple[float, float],
        exposure: float | None,
        pre_exposure: float,
        reset: bool,
    ) -> Iterator[list[Any]]:
        """Record a step with tensors as one with a frame that is copied from the device; see `step`.

        Raises:
            FrameError: the tensors are not a valid frame; the block was not run.
        """
        if not self._is_on():
            yield []
            return
        frame = frame_of_tensors(
            tensors, jitter, exposure, pre_exposure=pre_exposure, reset=reset, inputs=self._inputs
        )
        with self.step("step_tensors", frame, ()) as results:
            yield results

    def reset(self) -> None:
        """Record a reset, before it is made."""
        if self._is_on():
            with self._transaction():
                self._append({"call": "reset"})

    def load_state(self, state: State) -> None:
        """Record a state, before it is loaded."""
        if self._is_on():
            name = STATE.format(self._states)
            shaded = {f"{SHADED}{key}": array for key, array in (state.shaded or {}).items()}
            is_there = {key: getattr(state, key) is not None for key in ("history", "shaded")}
            with self._transaction():
                write_safetensors(self.path / name, {**(state.history or {}), **shaded})
                self._append({"call": "load_state", **vars(state), **is_there}, [name])
            self._states += 1

    def close(self) -> None:
        """Write the last image and end the recording."""
        if self._is_on():
            with self._transaction():
                if self._last is not None:
                    write_exr(self.path / LAST_IMAGE, self._last, compression="none")
                self._append({"call": "close"}, [] if self._last is None else [LAST_IMAGE])
            self._stop()

    def _list_in_shot(self, entry: FrameEntry, image: Float32) -> None:
        """List a frame in shot.json, after its step has accepted it."""
        entries = [*self._entries, entry]
        info = ShotInfo(
            name=self.path.name,
            render_size=entries[0].render_size or (0, 0),
            display_size=(image.shape[1], image.shape[0]),
            frame_rate=None,  # unknown to an Upscaler
            conventions=Conventions(),
        )
        write_text(self.path / FILE_NAME, shot_json(info, entries))
        self._entries = entries

    def _append(self, line: Mapping[str, Any], files: Collection[str] = ()) -> None:
        """Append a line to the log, with the hashes of its files."""
        if files:
            line = {**line, "sha256": {name: sha256(self.path / name) for name in files}}
        data = memoryview(json.dumps(line, allow_nan=False).encode() + b"\n")
        while data and self._log is not None:  # on a nearly full disk only a part is written
            data = data[self._log.write(data) :]

    def _log_end(self) -> int:
        return 0 if self._log is None else self._log.tell()

    def _cut(self, end: int, files: Collection[str] = ()) -> None:
        """Truncate the log to its first `end` bytes and remove files, if the disk allows."""
        with suppress(OSError):
            if self._log is not None:
                self._log.seek(end)
                self._log.truncate()
            remove_files(self.path / name for name in files)

    @contextmanager
    def _transaction(self, undo: Callable[[], None] = lambda: None, *, raises: bool = True) -> Iterator[None]:
        """After an error, remove the block's lines from the log; after a disk error also `undo` and stop.

        Raises:
            RecordingError: the disk refused; without `raises`, the next call raises it instead.
        """
        end = self._log_end()
        try:
            yield
        except BaseException as error:
            self._cut(end)
            if not isinstance(error, OSError):
                raise
            undo()
            self._stop()
            if isinstance(error, RecordingError):
                raise
            problem = error.problem if isinstance(error, ShotError) else f"cannot be written ({error})"
            self._failure = RecordingError(self.path, problem, NO_ROOM)
            self._failure.__cause__ = error
            if raises:
                self._is_on()

    def _is_on(self) -> bool:
        """Return whether calls are recorded; raise where the previous outcome could not be written."""
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure
        return self._log is not None

    def _stop(self) -> None:
        if self._log is not None:
            self._close_log()
        self._log = self._last = None


def returned(index: int, result: StepResult) -> StepOutcome:
    """Return the outcome of step `index`, which returned `result`."""
    arrays = {name: array for name, array in vars(result).items() if array is not None}
    images = {name: arrays[name] for name in ("image", "aovs") if name in arrays}
    return StepOutcome(
        {name: _crc32(array) for name, array in arrays.items()},
        {name: _sampled(index, image) for name, image in images.items()},
    )


def raised(error: Exception) -> StepOutcome:
    """Return the outcome of a step that raised `error`."""
    return StepOutcome(error=(type(error).__name__, str(error)))


def holds_only_a_recording(path: Path) -> bool:
    """Return whether a folder, which is not a link, holds a recording and no other file."""
    if not (is_own_folder(path) and is_regular(path / SETUP)):
        return False
    log = (path / CALLS).read_bytes() if is_regular(path / CALLS) else b""
    counts = {".exr": log.count(b'"frame": {'), ".safetensors": log.count(b'"call": "load_state"')}
    for place, folders, files in os.walk(path):  # follows no links
        for item in (Path(place, name) for name in (*folders, *files)):
            name = item.relative_to(path).as_posix()
            is_ours = is_own_folder(item) if name in _FOLDERS else is_regular(item) and _FILES.fullmatch(name)
            # a killed process may leave the files of one more call than the log has
            if not is_ours or (item.stem.isdigit() and int(item.stem) > counts[item.suffix]):
                return False
    return True


def remove_recording(path: Path) -> None:
    """Remove a recording's folder where it exists.

    Raises:
        RecordingError: it is no recording, or holds other files; nothing is removed.
        ShotError: the disk refused.
    """
    if not is_there(path):
        return
    if not holds_only_a_recording(path):
        raise RecordingError(path, "is no recording, or holds other files, too", "Move it away.")
    for place in (*(path / name for name in _FOLDERS if is_own_folder(path / name)), path):
        remove_files(file for file in place.iterdir() if file.is_file())
        remove_empty_folders([place])


def _sampled(index: int, image: Float32) -> Float32:
    """Return every s-th pixel of (H, W, k) in x and y, s = ceil(sqrt(H W / SAMPLES)).

    The offset changes with the index of the step.
    """
    height, width = image.shape[:2]
    stride = math.ceil(math.sqrt(height * width / SAMPLES))
    top, left = index % min(stride, height), index // stride % min(stride, width)
    return image[top::stride, left::stride]


def _write_samples(path: Path, outcome: StepOutcome) -> None:
    """Write the kept pixels of a step's images; ShotError where the disk refuses."""
    image, aovs = outcome.samples["image"], outcome.samples.get("aovs")
    names = [*COLOR, *aov_channels(0 if aovs is None else aovs.shape[2])]
    pixels = image if aovs is None else np.concatenate([image, aovs], axis=-1)
    write_exr(path, pixels, names, compression="none")


def _crc32(array: NDArray[Any]) -> int:
    return zlib.crc32(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
