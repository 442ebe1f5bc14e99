"""Tests of `Shot` and `ShotWriter`: reading on demand, order, exact pixels, atomic writes."""

import gc
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from supersampler import ArgumentError, Frame, FrameError, ShotError
from supersampler.conventions import Conventions, RawFrame
from supersampler.io.files import partial_name
from supersampler.io.images import read_exr, write_exr
from supersampler.io.shot import Shot, ShotWriter, copy_shot
from supersampler_model.data.scenes.analytic import Plane, checker

SIZE, DISPLAY_SIZE = (16, 9), (32, 18)
SCENE = Plane(checker, (2.0, -1.0))


def frame(index: int, *, size: tuple[int, int] = SIZE) -> Frame:
    """Frame of a checker that pans by (2, -1) units, which are 0.5 and -0.25 pixels."""
    return SCENE.frame(index, size, (0.1 * (index % 4), -0.05 * index % 0.5))


def write_shot(folder: Path, count: int = 4, **options: Any) -> Shot:
    """Write frames of the test scene, with a reference on each even one."""
    with ShotWriter(folder, name="test", display_size=DISPLAY_SIZE, frame_rate=24, **options) as writer:
        for index in range(len(writer), count):
            reference = SCENE.truth(index, DISPLAY_SIZE, 1) if index % 2 == 0 else None
            writer.write(frame(index), reference=reference)
    return Shot.open(folder)


def assert_same(a: Frame | RawFrame, b: Frame | RawFrame, *, tolerance: float = 0.0) -> None:
    """All fields of two frames are equal; arrays within a tolerance, and of one type."""
    for name in ("color", "depth", "motion", "reactive", "aovs"):
        x, y = getattr(a, name), getattr(b, name)
        assert (x is None) == (y is None), name
        if x is not None:
            assert tolerance or x.dtype == y.dtype, name
            np.testing.assert_allclose(x, y, rtol=0, atol=tolerance, err_msg=name)
    np.testing.assert_allclose(a.jitter or (0, 0), b.jitter or (0, 0), rtol=0, atol=tolerance)
    assert (a.reset, a.exposure, a.pre_exposure) == (b.reset, b.exposure, b.pre_exposure)
    for name in ("gbuffer", "gbuffer_display"):
        x, y = getattr(a, name) or {}, getattr(b, name) or {}
        assert x.keys() == y.keys(), name
        for key in x:
            np.testing.assert_array_equal(x[key], y[key])


def test_what_is_written_is_read_in_order(tmp_path: Path) -> None:
    shot = write_shot(tmp_path, license="CC0", attribution=["Ann"])
    assert (shot.name, shot.render_size, shot.display_size, shot.frame_rate) == (
        "test",
        SIZE,
        DISPLAY_SIZE,
        24.0,
    )
    assert (shot.info.license, shot.info.attribution, shot.path) == ("CC0", ("Ann",), tmp_path)
    assert (len(shot), shot.reference_indices) == (4, [0, 2])
    for index, item in enumerate(shot):
        assert item.index == index
        assert_same(item.frame, frame(index))
        assert (item.reference is not None) == (index % 2 == 0)
        if item.reference is not None:
            assert item.reference.dtype == np.float32
            np.testing.assert_array_equal(item.reference, SCENE.truth(index, DISPLAY_SIZE, 1))


def test_every_input_a_frame_can_have_is_kept(tmp_path: Path) -> None:
    random = np.random.default_rng(0)

    def pixels(size: tuple[int, int], *channels: int, kind: type = np.float16) -> np.ndarray:
        return random.random((size[1], size[0], *channels)).astype(kind)

    full = Frame(
        color=pixels(SIZE, 3),
        depth=pixels(SIZE, kind=np.float32),
        motion=pixels(SIZE, 2),
        jitter=(0.25, -0.125),
        exposure=1.5,
        pre_exposure=0.375,
        reactive=pixels(SIZE),
        gbuffer={
            "base_color": pixels(SIZE, 3),
            "roughness": pixels(SIZE, kind=np.float32),
            "normal": pixels(SIZE, 3),
        },
        gbuffer_display={"depth": pixels(DISPLAY_SIZE, kind=np.float32), "specular": pixels(DISPLAY_SIZE)},
        aovs=pixels(SIZE, 11),
    )
    one = Frame(color=None, depth=full.depth, motion=full.motion, jitter=(0.0, 0.0), aovs=pixels(SIZE, 1))
    with ShotWriter(tmp_path, name="full", display_size=DISPLAY_SIZE, frame_rate=30) as writer:
        writer.write(full)
        writer.write(one)
    for item, written in zip(Shot.open(tmp_path), (full, one), strict=True):
        assert_same(item.frame, written)


def test_the_render_size_may_change_from_frame_to_frame(tmp_path: Path) -> None:
    sizes = [SIZE, (11, 7), SIZE, (20, 12)]
    with ShotWriter(tmp_path, name="dynamic", display_size=None, frame_rate=30) as writer:
        for index, size in enumerate(sizes):
            writer.write(frame(index, size=size))
    shot = Shot.open(tmp_path)
    assert shot.render_size == SIZE
    assert [item.frame.size for item in shot] == sizes


def test_frames_are_stored_in_the_shots_conventions_and_read_in_ours(tmp_path: Path) -> None:
    shot = write_shot(tmp_path, conventions=Conventions.unreal())
    for index, item in enumerate(shot):
        assert_same(item.frame, frame(index), tolerance=1e-5)
        assert not np.allclose(item.raw.motion, item.frame.motion)
    assert shot.conventions == Conventions.unreal()


def test_any_frame_can_be_read_on_its_own(tmp_path: Path) -> None:
    jittered = Conventions(motion_jittered=True)
    shot = write_shot(tmp_path, conventions=jittered)
    in_order = [item.frame for item in shot]
    for index in (3, 0, 2, 1):
        assert_same(shot.read(index).frame, in_order[index], tolerance=1e-6)
        assert_same(shot.read(index).frame, frame(index), tolerance=1e-5)
        assert_same(next(shot.frames(index)).frame, in_order[index], tolerance=1e-6)
    for index in (-1, 4):
        with pytest.raises(IndexError, match=f"frame {index} of 4"):
            shot.read(index)


# --- lazy reading ---


def counted(shot: Shot) -> list[int]:
    """Record which frames a shot reads."""
    reads: list[int] = []
    read = shot._raw

    def recording(index: int, gbuffers: Collection[str] | None) -> RawFrame:
        reads.append(index)
        return read(index, gbuffers)

    shot._raw = recording
    return reads


def shot_threads() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name.startswith("shot")]


def test_frames_are_read_ahead_by_threads_but_not_far(tmp_path: Path) -> None:
    shot = write_shot(tmp_path, 8)
    reads = counted(shot)
    frames = shot.frames()
    assert reads == []  # nothing before the first is asked for
    next(frames)
    assert 2 <= len(shot_threads()) <= 3
    deadline = time.monotonic() + 5
    while len(reads) < 3 and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.05)  # long enough for more, if more were to come
    assert sorted(reads) == [0, 1, 2]
    assert [item.index for item in frames] == list(range(1, 8))
    assert shot_threads() == []


def test_the_threads_end_when_the_iterator_is_dropped(tmp_path: Path) -> None:
    frames = iter(write_shot(tmp_path, 8))
    next(frames)
    assert 2 <= len(shot_threads()) <= 3
    del frames
    gc.collect()
    assert shot_threads() == []


def test_an_error_is_raised_where_its_frame_is_reached(tmp_path: Path) -> None:
    shot = write_shot(tmp_path, 4)
    (tmp_path / "0002.exr").write_bytes(b"")
    seen: list[int] = []
    with pytest.raises(ShotError, match=r"0002\.exr"):
        seen.extend(item.index for item in shot)
    assert seen == [0, 1]
    assert shot_threads() == []


def test_frames_stop_before_an_index(tmp_path: Path) -> None:
    shot = write_shot(tmp_path, 6)
    assert [item.index for item in shot.frames(1, 4)] == [1, 2, 3]
    assert [item.index for item in shot.frames(4, 99)] == [4, 5]


def test_the_last_cut_is_found_without_a_file(tmp_path: Path) -> None:
    shot = write_shot(tmp_path, 6)
    entries = enumerate(shot._entries)
    shot._entries = tuple(msgspec.structs.replace(entry, reset=index == 3) for index, entry in entries)
    for path in tmp_path.glob("*.exr"):
        path.unlink()
    assert [shot.last_cut(index) for index in range(6)] == [0, 0, 0, 3, 3, 3]


def test_memory_holds_a_few_frames_at_a_time(tmp_path: Path) -> None:
    alive: list[weakref.ref[object]] = []
    most = 0
    for item in write_shot(tmp_path, 12):
        alive.append(weakref.ref(item.frame.depth))
        most = max(most, sum(reference() is not None for reference in alive))
    assert most <= 2  # the one at hand and the one before, which `item` held until it was replaced


# --- bad files ---

Spoil = Callable[[Path], None]


def spoil_missing(path: Path) -> None:
    path.unlink()


def spoil_cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-200])


def spoil_size(path: Path) -> None:
    write_exr(path, {name: array[:, 1:] for name, array in read_exr(path).items()})


def without(channel: str) -> Spoil:
    def spoil(path: Path) -> None:
        write_exr(path, {name: array for name, array in read_exr(path).items() if name != channel})

    return spoil


@pytest.mark.parametrize(
    ("file", "spoil", "message"),
    [
        ("0001.exr", spoil_missing, "the file of frame 1 is missing. shot.json lists it"),
        ("reference/0002.exr", spoil_missing, "the file of frame 2 is missing"),
        ("0001.exr", spoil_cut, "cannot be read to its end .*damaged or cut off"),
        ("0001.exr", spoil_size, "is 15x9; the shot says 16x9"),
        ("reference/0002.exr", spoil_size, "is 31x18; the shot says 32x18"),
        ("0001.exr", without("depth.Z"), r"has no channel depth\.Z. It has R, G, B, motion\.X, motion\.Y"),
        ("0001.exr", without("G"), "has no channel G. It has R, B, depth"),
        ("0001.exr", without("motion.X"), r"has no channel motion\.X"),
        ("reference/0002.exr", without("B"), "has no channel B. It has R, G"),
    ],
)
def test_a_bad_file_is_named_with_what_is_wrong_and_the_fix(
    tmp_path: Path, file: str, spoil: Spoil, message: str
) -> None:
    write_shot(tmp_path)
    spoil(tmp_path / file)
    with pytest.raises(ShotError, match=message) as caught:
        list(Shot.open(tmp_path))
    assert caught.value.path == tmp_path / file


def test_a_frame_that_breaks_the_contract_is_named(tmp_path: Path) -> None:
    write_shot(tmp_path, 2)
    text = (tmp_path / "shot.json").read_text().replace('"jitter": [0.1', '"jitter": [3.1')
    (tmp_path / "shot.json").write_text(text)
    with pytest.raises(ShotError, match=r"0001\.exr: frame 1 breaks the contract: frame\.jitter is \(3\.1"):
        list(Shot.open(tmp_path))


# --- writing ---


def test_a_second_run_does_not_overwrite_a_shot(tmp_path: Path) -> None:
    write_shot(tmp_path, 2)
    with pytest.raises(ShotError, match=r"a shot of 2 frames is there already\. Resume it"):
        write_shot(tmp_path, 2)


def test_a_shot_is_not_resumed_with_other_properties(tmp_path: Path) -> None:
    write_shot(tmp_path, 2)
    with pytest.raises(ShotError, match=r"its frame_rate is 24\.0; this run's is 30\.0"):
        ShotWriter(tmp_path, name="test", display_size=DISPLAY_SIZE, frame_rate=30, resume=True)


def test_a_write_that_fails_leaves_the_shot_as_it_was_and_can_be_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    jittered = Conventions(motion_jittered=True)  # the writer must not have moved on to the failed frame
    writer = ShotWriter(tmp_path, name="t", display_size=None, frame_rate=24, conventions=jittered)
    writer.write(frame(0))
    before = sorted(path.name for path in tmp_path.rglob("*"))

    rename = Path.replace

    def full(path: Path, target: Path) -> None:
        if path.suffix == ".exr":
            raise OSError(28, "No space left on device")
        rename(path, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", full)
        with pytest.raises(ShotError, match=r"0001\.exr: cannot be written \(.*No space left"):
            writer.write(frame(1))
    assert sorted(path.name for path in tmp_path.rglob("*")) == before
    assert len(writer) == len(Shot.open(tmp_path)) == 1
    writer.write(frame(1))
    assert_same(Shot.open(tmp_path).read(1).frame, frame(1), tolerance=1e-6)


def test_a_frame_that_could_not_be_read_again_is_not_written(tmp_path: Path) -> None:
    writer = ShotWriter(tmp_path, name="test", display_size=None, frame_rate=24)
    flat = np.zeros((9, 16), np.float32)
    with pytest.raises(FrameError, match=r"frame\.motion is of shape \(9, 16\)"):
        writer.write(RawFrame(depth=flat, motion=flat))
    with pytest.raises(FrameError, match=r"frame\.jitter is \(3\.0, 0\.0\)"):
        writer.write(RawFrame(depth=flat, motion=np.zeros((9, 16, 2), np.float32), jitter=(3.0, 0.0)))
    assert list(tmp_path.iterdir()) == []


def test_arrays_of_the_wrong_display_size_are_refused(tmp_path: Path) -> None:
    writer = ShotWriter(tmp_path, name="test", display_size=DISPLAY_SIZE, frame_rate=24)
    with pytest.raises(ArgumentError, match=r"reference is 16x9; want the shot's display size, \(32, 18\)"):
        writer.write(frame(0), reference=np.zeros((9, 16, 3), np.float32))
    with pytest.raises(ArgumentError, match="Give the ShotWriter a display_size"):
        ShotWriter(tmp_path, name="test", display_size=None, frame_rate=24).write(
            frame(0), reference=np.zeros((9, 16, 3), np.float32)
        )
    assert len(writer) == 0


KILLED = """
import sys
from pathlib import Path
from typing import Any
sys.path[:0] = [{tests!r}, {here!r}]
from test_shot import write_shot
write_shot(Path({folder!r}), 10_000, resume=True)
"""


def test_a_killed_run_leaves_a_whole_shot_and_is_resumed_after_its_last_frame(tmp_path: Path) -> None:
    here = Path(__file__).parent
    code = KILLED.format(tests=str(here.parent), here=str(here), folder=str(tmp_path))
    for round_ in range(1, 3):
        process = subprocess.Popen([sys.executable, "-c", code])
        wait_for_frame(tmp_path, 12 * round_, process)
        process.kill()  # SIGKILL, or TerminateProcess on Windows
        process.wait()
        shot = Shot.open(tmp_path)
        assert len(shot) >= 12 * round_
        for item in shot:
            assert_same(item.frame, frame(item.index))
    count = len(shot) + 2
    again = write_shot(tmp_path, count, resume=True)
    assert len(again) == count
    assert_same(again.read(count - 1).frame, frame(count - 1))
    assert not list(tmp_path.rglob("*.partial.*"))


@pytest.mark.parametrize(
    "name", ["0003.exr", "display/0003.exr", "reference/0003.exr", "shot.json", ".shot.json.writing"]
)
def test_a_writer_removes_the_temporary_file_that_a_killed_one_left(tmp_path: Path, name: str) -> None:
    write_shot(tmp_path, 3)
    left = partial_name(tmp_path / name)
    left.parent.mkdir(exist_ok=True)
    left.write_bytes(b"half")
    write_shot(tmp_path, 4, resume=True)
    assert not left.exists()


def wait_for_frame(folder: Path, index: int, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + 60
    while not (folder / f"{index:04d}.exr").exists():
        assert process.poll() is None, "the run ended by itself"
        assert time.monotonic() < deadline
        time.sleep(0.005)


def test_a_copy_is_the_same_and_can_be_resumed(tmp_path: Path) -> None:
    shot = write_shot(tmp_path / "a", 5, conventions=Conventions.fsr(), license="CC0")
    write_first(shot, tmp_path / "b", 2)
    copy = copy_shot(shot, tmp_path / "b", resume=True)
    assert (copy.info, copy.reference_indices) == (shot.info, shot.reference_indices)
    for a, b in zip(shot, copy, strict=True):
        assert_same(a.raw, b.raw)


def write_first(shot: Shot, folder: Path, count: int) -> None:
    info = shot.info
    writer = ShotWriter(
        folder, name=info.name, display_size=info.display_size, frame_rate=info.frame_rate,
        conventions=info.conventions, license=info.license,
    )  # fmt: skip
    for index in range(count):
        writer.write(shot.read_raw(index), reference=shot.read_reference(index))
