"""Fuzz tests of recordings: damaged ones are replayed or refused with an error of the package."""

import json
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

import upscale_runs
from fuzzing import damaged, dumped, examples, replaced, run_apart, with_extremes
from recorded_files import read, rewrite
from still_states import FRAMES, frame, loaded, still_state
from supersampler import ShotError, Upscaler
from supersampler.recording import open_recording
from supersampler.recording.replay import Replay

Rng = np.random.Generator


def recorded(method: str) -> dict[str, bytes]:
    """Return the files of a recording of all kinds of calls."""
    folder = Path(f"{method}.recording")
    options: dict[str, Any] = {"validate": "off", "extrapolation": "guided-warp", "record": folder}
    with Upscaler(loaded(method, "cpu"), display_size=(80, 48), **options) as upscaler:
        upscaler.step(frame(0))
        upscaler.extrapolate(frame(1, color=None))
        upscaler.load_state(still_state(method))
        upscaler.step(frame(FRAMES, aovs=np.ones((24, 40, 2), np.float32)), outputs=("aovs", "weight"))
        upscaler.reset()
        upscaler.step(frame(0))
    return upscale_runs.files(folder)


def hostile(files: dict[str, bytes], rng: Rng, folder: Path) -> None:
    """Write a recording with one or two changes: to the setup, texts, arrays, or bytes of a file."""
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    for _ in range(int(rng.integers(1, 3))):
        path, other = (folder / str(rng.choice([n for n in files if n != "recording.json"])) for _ in "ab")
        with suppress(ShotError, LookupError):  # damaged before
            match int(rng.integers(0, 7)):
                case 0:
                    setup = folder / "recording.json"
                    setup.write_bytes(_changed(setup.read_bytes(), rng))
                case 1 | 2:
                    text, arrays = read(path)
                    rewrite(path, _changed(text.encode(), rng).decode(errors="replace"), arrays)
                case 3:
                    text, arrays = read(path)
                    rewrite(path, text, {name: with_extremes(array, rng) for name, array in arrays.items()})
                case 4:
                    rewrite(path, read(path)[0], read(other)[1])
                case 5:
                    path.write_bytes(other.read_bytes())
                case _:
                    path.write_bytes(damaged(path.read_bytes(), rng))


def _changed(text: bytes, rng: Rng) -> bytes:
    try:
        value: Any = replaced(json.loads(text), rng)
    except ValueError:  # damaged before
        return text
    return dumped(value)


def prepare() -> Callable[[int], object]:
    recordings = [recorded(method) for method in ("taau", "classifier-small")]
    folder = Path("case.recording")

    def run(case: int) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        hostile(recordings[case % 2], np.random.default_rng(case), folder)
        replay = Replay(open_recording(folder))
        for call in replay.recording:
            done = replay.call(call)
            if done is not None and done.result is not None:
                assert np.isfinite(done.result.image).all()

    return run


def test_no_recording_harms_its_replay() -> None:
    assert run_apart(prepare, examples(30)) == []
