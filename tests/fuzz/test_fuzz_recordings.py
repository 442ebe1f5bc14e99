"""Fuzz tests of recordings: damaged ones are replayed or refused with an error of the package."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fuzzing import damaged, examples, replaced, run_apart
from recorded_files import with_hashes
from still_states import FRAMES, frame, loaded, still_state
from supersampler import Upscaler
from supersampler.recording import open_recording
from supersampler.recording.replay import Replay

Rng = np.random.Generator


def recorded(method: str) -> dict[str, bytes]:
    """Return the files of a recording of all kinds of calls."""
    folder = Path(f"{method}.recording")
    with Upscaler(
        loaded(method, "cpu"),
        display_size=(80, 48),
        validate="off",
        extrapolation="guided-warp",
        record=folder,
    ) as upscaler:
        upscaler.step(frame(0))
        upscaler.extrapolate(frame(1, color=None))
        upscaler.load_state(still_state(method))
        upscaler.step(frame(FRAMES, aovs=np.ones((24, 40, 2), np.float32)), outputs=("aovs", "weight"))
        upscaler.reset()
        upscaler.step(frame(0))
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def hostile(files: dict[str, bytes], rng: Rng) -> dict[str, bytes]:
    """Return a recording with one or two changes: to the log, the setup, or the bytes of any file."""
    files = dict(files)
    for _ in range(int(rng.integers(1, 3))):
        name = str(rng.choice([*files]))
        lines = files["calls.jsonl"].splitlines()
        match int(rng.integers(0, 8)):
            case 0:
                lines.insert(int(rng.integers(len(lines))), lines[int(rng.integers(len(lines)))])
            case 1 | 2 | 3:
                at = int(rng.integers(len(lines)))
                lines[at] = _changed(lines[at], rng)
            case 4:
                files["recording.json"] = _changed(files["recording.json"], rng)
            case 5 if name.endswith((".exr", ".safetensors")):
                files[name] = _with_extremes(files[name], rng)
            case 6 if name.endswith(".exr"):
                files[name] = files[str(rng.choice([n for n in files if n.endswith(".exr")]))]
            case _:
                files[name] = damaged(files[name], rng)
                continue
        files["calls.jsonl"] = b"".join(line + b"\n" for line in lines)
    return with_hashes(files) if rng.random() < 0.9 else files


def _changed(text: bytes, rng: Rng) -> bytes:
    try:
        value: Any = replaced(json.loads(text), rng)
        return json.dumps(value).encode()
    except ValueError:  # damaged before
        return text
    except RecursionError:
        return b"[" * 5000


def _with_extremes(data: bytes, rng: Rng) -> bytes:
    """Return a file with other numbers in its second half, where pixels or tensors are."""
    begin = len(data) // 2 // 4 * 4
    values = np.frombuffer(data[begin : len(data) // 4 * 4], np.float32).copy()
    extreme = rng.choice([np.nan, np.inf, -1.0, 1e30, 1e-42])
    values[rng.random(values.size) < rng.choice([0.01, 1.0])] = extreme
    return data[:begin] + values.tobytes() + data[len(data) // 4 * 4 :]


def prepare() -> Callable[[int], object]:
    recordings = [recorded(method) for method in ("taau", "classifier-small")]
    folder = Path("case.recording")

    def run(case: int) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        for name, data in hostile(recordings[case % 2], np.random.default_rng(case)).items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)
        replay = Replay(open_recording(folder))
        for call in replay.recording:
            done = replay.call(call)
            if done is not None and done.result is not None:
                assert np.isfinite(done.result.image).all()

    return run


def test_no_recording_harms_who_replays_it() -> None:
    assert run_apart(prepare, examples(30)) == []
