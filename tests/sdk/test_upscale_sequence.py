"""`upscale_sequence`: order, bounded reading, scratch files, cuts, bad input; and the same by the command."""

import errno
import gc
import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from noise import noise
from shared_models import shared_model
from supersampler import ArgumentError, Frame, Shot, ShotError, Upscaler, halton_jitter, upscale_sequence
from supersampler.io.display import decibels, display_transform
from supersampler.io.images import read_exr
from supersampler.io.shot import ShotWriter
from supersampler.sequence import both_ways
from supersampler.sequence.backward_motion import reversed_frame
from supersampler.sequence.frame_store import FrameStore, Stored
from supersampler_bench.specs import with_default_gbuffers
from supersampler_model.data.scenes.analytic import AnalyticScene, DiscOverPlane, Plane, zone_plate
from upscale_runs import DISPLAY_SIZE, images, moving, pixels, run, upscale, write_shot

COUNT = 11
SMALL = both_ways.ChunkSize(4, 2)


@pytest.fixture
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        both_ways.ChunkSize, "__new__", lambda cls, *given: tuple.__new__(cls, given or SMALL)
    )


@pytest.fixture
def on_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("supersampler.sequence.frame_store.MEMORY", 0.0)


def frames(count: int = COUNT, cuts: tuple[int, ...] = ()) -> list[Frame]:
    return [moving(index, reset=index in (0, *cuts)) for index in range(count)]


def merged_lazily(given: Any, **options: Any) -> Iterator[np.ndarray]:
    return upscale_sequence(given, display_size=DISPLAY_SIZE, **{"model": "taau", **options})


def merged(given: Any, **options: Any) -> list[np.ndarray]:
    return list(merged_lazily(given, **options))


def test_one_pass_is_step_bit_for_bit() -> None:
    upscaler = Upscaler("taau", display_size=DISPLAY_SIZE)
    stepped = [upscaler.step(frame) for frame in frames()]
    assert all(map(np.array_equal, merged(frames(), passes=1), stepped))


@pytest.mark.usefixtures("small_chunks")
def test_lists_generators_and_shots_give_the_same_images(tmp_path: Path) -> None:
    write_shot(tmp_path / "shot", COUNT, cuts=(7,))
    shot = Shot.open(tmp_path / "shot")
    given = [item.frame for item in shot]
    of_list = merged(given)
    assert len(of_list) == COUNT
    for other in (merged(frame for frame in given), merged(shot), merged(iter(shot))):
        assert all(map(np.array_equal, of_list, other))


@pytest.mark.usefixtures("small_chunks")
def test_a_cut_separates_what_is_before_from_what_is_after() -> None:
    whole = merged(frames(9, cuts=(5,)))
    alone = [merged(frames(9, cuts=(5,))[part]) for part in (slice(0, 5), slice(5, 9))]
    assert all(map(np.array_equal, whole, [*alone[0], *alone[1]]))


def test_a_frame_alone_between_cuts_has_the_image_of_one_pass() -> None:
    given = frames(5, cuts=(1, 2, 3, 4))
    for one, two in zip(merged(given, passes=1), merged(given), strict=True):
        np.testing.assert_allclose(two, one, rtol=1e-5)


@pytest.mark.long  # upscales shots both ways
@pytest.mark.parametrize(
    ("scene", "method"),
    [
        pytest.param(DiscOverPlane(), "taau", id="disc"),
        pytest.param(Plane(zone_plate), "taau", id="still"),
        pytest.param(Plane(zone_plate, velocity=(0.37, 0.21)), "classifier", id="pan"),
    ],
)
def test_two_passes_are_nearer_to_the_truth_than_one(scene: AnalyticScene, method: str) -> None:
    jitters = [halton_jitter(index, 2.0) for index in range(10)]
    shown = [scene.frame(index, (64, 36), jitter) for index, jitter in enumerate(jitters)]
    given = [replace(one, exposure=1.0, reset=index == 0) for index, one in enumerate(shown)]
    truths = [scene.truth(index, (128, 72)) for index in range(10)]

    def scores(passes: int) -> np.ndarray:
        result = upscale_sequence(given, display_size=(128, 72), model=method, passes=passes)
        pairs = [map(display_transform, pair) for pair in zip(result, truths, strict=True)]
        return np.array([decibels(float(np.square(np.subtract(*pair)).mean())) for pair in pairs])

    gain = scores(2) - scores(1)
    assert gain.mean() > 0.4
    assert gain[-1] > -0.2  # there the backward run has one sample


@pytest.mark.parametrize("lookahead", [1, 3])
def test_live_images_come_two_blocks_late(
    lookahead: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path / "nowhere"))  # memory alone is used
    steps, read, step = [0], [0], Upscaler.step

    def counted(self: Upscaler, *given: Any, **options: Any) -> Any:
        steps[0] += 1
        return step(self, *given, **options)

    def live() -> Iterator[Frame]:
        buffers = {name: np.empty_like(getattr(moving(0), name)) for name in ("color", "depth", "motion")}
        for index in range(12):
            read[0] += 1
            for name, buffer in buffers.items():  # an engine uses the same buffers again
                buffer[...] = getattr(moving(index), name)
            yield moving(index, **buffers)

    monkeypatch.setattr(Upscaler, "step", counted)
    images, result = merged_lazily(live(), lookahead=lookahead), []
    for index, image in enumerate(images):
        result.append(image)
        assert read[0] - index <= 2 * lookahead
    assert steps[0] <= 3 * 12
    monkeypatch.setattr(Upscaler, "step", step)
    assert all(map(np.array_equal, result, merged(frames(12), lookahead=lookahead)))


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The scratch files that are made."""
    files: list[Any] = []
    make = tempfile.TemporaryFile

    def kept(*given: Any, **options: Any) -> Any:
        files.append(make(*given, **options))
        return files[-1]

    monkeypatch.setattr("supersampler.sequence.frame_store.tempfile.TemporaryFile", kept)
    return files


@pytest.mark.usefixtures("small_chunks", "on_disk")
def test_no_more_than_a_chunk_and_its_overlap_are_kept(tmp_path: Path, made: list[Any]) -> None:
    image = 4 * 3 * DISPLAY_SIZE[0] * DISPLAY_SIZE[1]  # bytes; a frame has fewer
    most = 0
    for _ in merged_lazily(frames(20), scratch=tmp_path):
        (file,) = made
        most = max(most, os.fstat(file.fileno()).st_size)
    assert 0 < most <= (sum(SMALL) + SMALL.frames) * image  # frames, and backward images


def test_arrays_of_changing_sizes_do_not_make_the_scratch_file_grow(made: list[Any]) -> None:
    store, waiting, sizes = FrameStore(memory=0.0), list[Stored](), list[int]()
    for index in range(400):
        waiting.append(store.put({"a": np.full((1 + index * 7919 % 977,), index, np.float64)}))
        if len(waiting) > 8:
            first = waiting.pop(0)
            assert (store.get(first)["a"] == index - 8).all()
            store.drop(first)
        sizes.append(os.fstat(made[0].fileno()).st_size)
    store.close()
    assert max(sizes) < 4 * 9 * 977 * 8


@pytest.mark.usefixtures("on_disk")
def test_the_scratch_file_has_no_name_and_is_closed_whatever_happens(tmp_path: Path, made: list[Any]) -> None:
    closed = merged_lazily(frames(), scratch=tmp_path)
    next(closed)
    assert list(tmp_path.iterdir()) == []  # so that a process that is killed leaves nothing
    closed.close()  # type: ignore[attr-defined]

    deleted = merged_lazily(frames(), scratch=tmp_path)
    next(deleted)
    del deleted
    gc.collect()

    def broken() -> Iterator[Frame]:
        yield from frames(3)
        raise ValueError("the renderer stopped")

    with pytest.raises(ValueError, match="the renderer stopped"):
        list(merged_lazily(broken(), scratch=tmp_path))
    assert [file.closed for file in made] == [True, True, True]


@pytest.mark.usefixtures("on_disk")
def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Full(FileIO):
        def write(self, data: Any) -> int:
            if self.tell() > 10_000:
                raise OSError(errno.ENOSPC, "No space left on device")
            return super().write(data)

    opened = Full(tmp_path / "scratch", "x+")
    monkeypatch.setattr("supersampler.sequence.frame_store.tempfile.TemporaryFile", lambda **_: opened)
    with pytest.raises(ShotError, match="No space left on device") as error:
        list(merged_lazily(frames(), scratch=tmp_path))
    assert "scratch" in str(error.value)
    assert "\n" not in str(error.value)
    assert opened.closed


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"passes": 3}, "passes is 3; want 1 or 2"),
        ({"passes": True}, "passes is True"),
        ({"lookahead": 0}, "lookahead is 0"),
        ({"lookahead": 65}, "lookahead is 65"),
        ({"passes": 1, "lookahead": 4}, "want None, because one pass"),
        ({"scratch": 5}, "scratch is 5"),
        ({"display_size": None}, "display_size or scale is neither"),
    ],
)
def test_arguments_are_refused_before_a_frame_is_read(options: dict[str, Any], said: str) -> None:
    def never() -> Iterator[Frame]:
        raise AssertionError("read")
        yield

    with pytest.raises(ArgumentError, match=said):
        upscale_sequence(never(), **{"display_size": DISPLAY_SIZE, "model": "taau", **options})
    with pytest.raises(ArgumentError, match="frames is 5"):
        upscale_sequence(5, display_size=DISPLAY_SIZE)  # type: ignore[arg-type]
    with pytest.raises(ShotError, match="nowhere"):
        list(merged_lazily(frames(2), scratch=Path("nowhere")))


def test_images_are_the_same_from_memory_and_from_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    in_memory = merged(frames())
    for limit in (0.0, 40_000.0):
        monkeypatch.setattr("supersampler.sequence.frame_store.MEMORY", limit)
        assert all(map(np.array_equal, merged(frames()), in_memory))


def test_gbuffers_reach_both_runs_from_the_disk_too(monkeypatch: pytest.MonkeyPatch) -> None:
    model = shared_model("gbuffer-small", providers="cpu")
    given = [with_default_gbuffers(frame, model.info.gbuffers, DISPLAY_SIZE) for frame in frames(3)]
    in_memory = merged(given, model=model)
    monkeypatch.setattr("supersampler.sequence.frame_store.MEMORY", 0.0)
    assert all(map(np.array_equal, merged(given, model=model), in_memory))
    backward = Upscaler(model, display_size=DISPLAY_SIZE)
    following: Frame | None = None
    for frame in reversed(given):
        alone, following = backward.step(reversed_frame(frame, following)), frame
    first = Upscaler(model, display_size=DISPLAY_SIZE).step(given[0])
    between = np.minimum(first, alone) - 1e-5, np.maximum(first, alone) + 1e-5
    assert (between[0] <= in_memory[0]).all()
    assert (in_memory[0] <= between[1]).all()
    assert np.abs(in_memory[0] - first).max() > 1e-3


def test_unusable_values_do_not_spread() -> None:
    given = frames(6)
    color, motion, depth = given[2].color, given[3].motion, given[4].depth
    assert color is not None
    color[3:5, 4:9], motion[2:6, 5:7], depth[7:9, 1:4] = np.nan, np.inf, np.nan
    for image in merged(given, validate="off"):
        assert np.isfinite(image).all()
        assert (image >= 0).all()


def test_sizes_may_change_within_a_sequence() -> None:
    given = frames(6)
    given[3], given[5] = noise(3, (20, 12)), noise(5, (20, 12))
    images = merged(given)
    assert [image.shape for image in images] == [(36, 64, 3)] * 6
    by_scale = list(upscale_sequence(given, scale=2, model="taau"))
    np.testing.assert_array_equal(by_scale, images)  # the backward run begins with a smaller frame


@pytest.mark.usefixtures("small_chunks")
def test_the_command_writes_the_images_of_the_library(tmp_path: Path) -> None:
    shot = write_shot(tmp_path / "shot", COUNT, cuts=(6,))
    upscale(shot, tmp_path / "out", "--passes", 2, "--scratch", tmp_path, method="taau")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "shot"]
    for index, image in enumerate(merged(Shot.open(shot))):
        stored = pixels(tmp_path / "out" / f"{index:04d}.exr")
        np.testing.assert_array_equal(stored, image.astype(np.float16).astype(np.float32))


@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize("kept", [3, 7, 10])
def test_a_stopped_command_continues_to_the_same_images(kept: int, tmp_path: Path) -> None:
    shot = write_shot(tmp_path / "shot", COUNT, cuts=(6,))
    upscale(shot, tmp_path / "out", "--passes", 2, method="taau")
    whole = images(tmp_path / "out")
    for index in range(kept, COUNT):
        (tmp_path / "out" / f"{index:04d}.exr").unlink()
    upscale(shot, tmp_path / "out", "--passes", 2, method="taau")
    assert images(tmp_path / "out") == whole


@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize(("kept", "again"), [(6, 4), (5, 0), (9, 6)])
def test_later_frames_change_the_chunks_that_read_them(kept: int, again: int, tmp_path: Path) -> None:
    for name, count in (("whole", COUNT), ("part", kept), ("part", COUNT)):
        shutil.rmtree(tmp_path / "shot", ignore_errors=True)
        shot = write_shot(tmp_path / "shot", count, cuts=(6,) if kept == 9 else ())
        done = upscale(shot, tmp_path / name, "--passes", 2, method="taau")
    assert f"from frame {again} on" in done.stderr
    assert images(tmp_path / "part") == images(tmp_path / "whole")


def test_a_change_of_passes_needs_overwrite(tmp_path: Path) -> None:
    shot = write_shot(tmp_path / "shot", 3)
    upscale(shot, tmp_path / "out", method="taau")
    refused = run("upscale", shot, "-o", tmp_path / "out", "--passes", 2, "--method", "taau")
    assert refused.exit_code == 1
    assert "passes was None, is now 2" in refused.stderr
    recorded = run("upscale", shot, "-o", tmp_path / "new", "--passes", 2, "--record", tmp_path / "record")
    assert "--record is given with --passes 2" in recorded.stderr


def test_a_range_sees_frames_after_it(tmp_path: Path) -> None:
    shot = write_shot(tmp_path / "shot", COUNT, cuts=(9,))
    upscale(shot, tmp_path / "whole", "--passes", 2, "--preroll", 32, method="taau")
    upscale(shot, tmp_path / "part", "--passes", 2, "--frames", "4-6", method="taau")
    assert sorted(images(tmp_path / "part")) == ["0004.exr", "0005.exr", "0006.exr"]
    for name, data in images(tmp_path / "part").items():
        assert data == images(tmp_path / "whole")[name]


def test_alpha_is_merged_like_the_colour(tmp_path: Path) -> None:
    with ShotWriter(tmp_path / "shot", name="s", display_size=DISPLAY_SIZE, frame_rate=24) as writer:
        for index in range(5):
            color: Any = moving(index).color
            writer.write(moving(index, aovs=color[..., :1] * np.float32(1e-3), exposure=1e-3))
    for passes in (1, 2):
        upscale(tmp_path / "shot", tmp_path / str(passes), "--passes", passes, method="taau")
    one, two = (read_exr(tmp_path / str(passes) / "0001.exr") for passes in (1, 2))
    apart = [np.abs(1e3 * done["A"].astype(np.float32) - done["R"]).mean() for done in (one, two)]
    assert np.abs(two["A"].astype(np.float32) - one["A"]).max() > 2e-5
    assert apart[1] < 1.2 * apart[0]
