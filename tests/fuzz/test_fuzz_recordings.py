"""Whatever a recording holds, opening and replaying it ends in images or in errors of ours."""

import json
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fuzzing import damaged, examples, replaced, run_apart
from still_states import FRAMES, frame, loaded, still_state
from supersampler import Upscaler
from supersampler.recording import open_recording
from supersampler.recording.format import MAGIC, Record, octets, read_records
from supersampler.recording.replay import Replay

Rng = np.random.Generator


def recorded(method: str) -> list[Record]:
    """A recording of all kinds of calls."""
    path = Path(f"{method}.recording")
    with Upscaler(
        loaded(method, "cpu"),
        display_size=(80, 48),
        validate="off",
        extrapolation="guided-warp",
        record=path,
    ) as upscaler:
        upscaler.step(frame(0))
        upscaler.extrapolate(frame(1, color=None))
        upscaler.load_state(still_state(method))
        upscaler.step(frame(FRAMES, aovs=np.ones((24, 40, 2), np.float32)), outputs=("aovs", "weight"))
        upscaler.reset()
        upscaler.step(frame(0))
    records = list(read_records(path))
    path.unlink()
    return records


def listed(record: Record) -> dict[str, Any]:
    """What the text of a record says."""
    arrays = [[name, array.dtype.str, list(array.shape)] for name, array in record.arrays.items()]
    text = {"record": record.kind, **record.values, "arrays": arrays}
    return dict(json.loads(json.dumps(text)))


def encoded(text: bytes, data: bytes) -> bytes:
    """A record with the right check sums, whatever it says."""
    head = struct.pack("<QII", len(text) + len(data), len(text), zlib.crc32(text + data))
    return head + struct.pack("<I", zlib.crc32(head)) + text + data


def hostile(records: list[Record], rng: Rng) -> bytes:
    """A file with changes to one or two records whose sums are right, or to any of its bytes."""
    texts, datas = [listed(record) for record in records], [_data(record) for record in records]
    for _ in range(int(rng.integers(1, 3))):
        at = int(rng.integers(len(texts)))
        match int(rng.integers(0, 8)):
            case 0 if datas[at]:
                datas[at] = damaged(datas[at], rng)
            case 1 if texts[at]["arrays"]:
                _reshape(texts[at]["arrays"], rng)
            case 2:
                texts.insert(at, texts[int(rng.integers(len(texts)))])
                datas.insert(at, datas[int(rng.integers(len(datas)))])
            case 3 if datas[at]:
                values = np.frombuffer(datas[at][: len(datas[at]) // 8 * 8], np.float32).copy()
                extreme = rng.choice([np.nan, np.inf, -1.0, 1e30, 1e-42])
                values[rng.random(values.size) < rng.choice([0.01, 1.0])] = extreme
                datas[at] = values.tobytes()
            case _:
                changed = replaced(
                    {name: value for name, value in texts[at].items() if name != "arrays"}, rng
                )
                if isinstance(changed, dict):
                    texts[at] = {**changed, "arrays": texts[at]["arrays"]}
    content = MAGIC + b"".join(encoded(_json(text), data) for text, data in zip(texts, datas, strict=True))
    return damaged(content, rng) if rng.random() < 0.1 else content


def _reshape(arrays: list[list[Any]], rng: Rng) -> None:
    """Another shape or type of as many bytes, as far as that goes: lengths must agree."""
    array = arrays[int(rng.integers(len(arrays)))]
    shape = array[2]
    if rng.random() < 0.5 and len(shape) > 1:
        array[2] = shape[::-1] if rng.random() < 0.5 else [shape[0] * shape[1], *shape[2:]]
    elif rng.random() < 0.5:
        array[1] = (
            array[1].replace("f4", str(rng.choice(["i4", "u4"]))).replace("<", str(rng.choice(["<", ">"])))
        )
    else:
        array[0] = str(
            rng.choice(["color", "depth", "gbuffer.x", "frame.y", "still.looks", "image", "shaded.x"])
        )


def _json(value: Any) -> bytes:
    try:
        return json.dumps(value).encode()
    except RecursionError:
        return b"[" * 5000


def _data(record: Record) -> bytes:
    return b"".join(bytes(octets(array)) for array in record.arrays.values())


def prepare() -> Callable[[int], object]:
    recordings = [recorded(method) for method in ("taau", "classifier-small")]
    path = Path("case.recording")

    def run(case: int) -> None:
        rng = np.random.default_rng(case)
        path.write_bytes(hostile(recordings[case % 2], rng))
        replay = Replay(open_recording(path))
        for call in replay.recording:
            done = replay.call(call)
            if done is not None and done.result is not None:
                assert np.isfinite(done.result.image).all()

    return run


def test_no_recording_harms_who_replays_it() -> None:
    assert run_apart(prepare, examples(30)) == []
