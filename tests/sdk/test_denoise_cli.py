"""`supersampler denoise`: images on disk that do not depend on how the run was split."""

import json
import shutil
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from OpenImageIO import ImageSpec
from typer.testing import Result

from exr_parts import write_parts
from noisy_frames import decibels, noisy, truth
from supersampler import Conventions
from supersampler.cli import denoise_run, frame_run
from supersampler.denoising.sequence import PerFrame
from supersampler.frame import Float32
from supersampler.io.images import read_exr, read_header, write_exr
from supersampler.io.shot import Shot, ShotWriter, open_source
from supersampler.io.shot.numbered import FrameRange
from upscale_runs import images, interrupt_at, pixels, run, said, succeeded

COUNT = 12


def write_noisy(folder: Path, count: int = COUNT, *, cuts: tuple[int, ...] = (), aovs: bool = False) -> Path:
    """Write a shot in place of what is there."""
    shutil.rmtree(folder, ignore_errors=True)
    with ShotWriter(folder, name=folder.name, display_size=(48, 30), frame_rate=24.0) as writer:
        for index in range(count):
            frame = noisy(index, reset=index in (0, *cuts))
            alpha = np.asarray(frame.color)[..., :1].clip(0.0, 1.0) if aovs else None
            writer.write(replace(frame, aovs=alpha), reference=truth(index))
    return folder


def denoise(shot: Path, output: Path, *words: str) -> Result:
    return run("denoise", shot, "-o", output, "--per-frame", "none", *words)


def assert_same(folder: Path, other: Path, numbers: Iterable[int]) -> None:
    """Images of both folders are equal."""
    for number in numbers:
        np.testing.assert_array_equal(image(folder, number), image(other, number))


def image(folder: Path, number: int) -> Float32:
    return pixels(folder / f"{number:04d}.exr")


def test_a_shot_becomes_a_folder_of_images_with_less_noise(tmp_path: Path) -> None:
    shot = write_noisy(tmp_path / "shot")
    result = succeeded(denoise(shot, tmp_path / "out", "--compare", "--json"))
    events = [json.loads(line) for line in result.stdout.splitlines()]
    assert [event["event"] for event in events] == ["begin", *["frame"] * COUNT, "end"]
    for number in range(COUNT):
        color = np.asarray(noisy(number).color, np.float32)
        assert decibels(image(tmp_path / "out", number), number) > decibels(color, number) + 2.0
    assert "PSNR" in (tmp_path / "out/compare.html").read_text("utf-8")
    assert "warning" not in result.stderr


def test_a_range_of_frames_is_equal_to_those_of_the_whole_run(tmp_path: Path) -> None:
    shot = write_noisy(tmp_path / "shot", 22, cuts=(3,))
    succeeded(denoise(shot, tmp_path / "whole"))
    succeeded(denoise(shot, tmp_path / "part", "--frames", "9-11"))
    assert not (tmp_path / "part/0008.exr").exists()
    assert_same(tmp_path / "part", tmp_path / "whole", range(9, 12))


@pytest.mark.parametrize("options", [(), ("--frames", "3-13")])
def test_a_stopped_run_continues_to_the_same_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...]
) -> None:
    monkeypatch.setattr(frame_run, "EXPOSURE_FRAMES", 2)  # the exposure of a TIFF follows all frames
    options = ("--format", "exr", "--format", "tif", *options)
    shot = write_noisy(tmp_path / "shot", 14)
    succeeded(denoise(shot, tmp_path / "whole", *options))
    with monkeypatch.context() as patch:
        interrupt_at(9, patch)
        assert denoise(shot, tmp_path / "out", *options).exit_code == 130
    assert not (tmp_path / "out/exr/0012.exr").exists()
    succeeded(denoise(shot, tmp_path / "out", *options))
    assert images(tmp_path / "out") == images(tmp_path / "whole")


@pytest.mark.parametrize(("cut", "again"), [(0, 2), (6, 6), (7, None)])
def test_frames_that_come_later_change_the_images_that_depend_on_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cut: int, again: int | None
) -> None:
    whole, out = tmp_path / "whole", tmp_path / "out"
    succeeded(denoise(write_noisy(tmp_path / "shot", cuts=(cut,)), whole))
    succeeded(denoise(write_noisy(tmp_path / "shot", 7, cuts=(cut,)), out))
    write_noisy(tmp_path / "shot", cuts=(cut,))
    with monkeypatch.context() as patch:
        interrupt_at(8, patch)
        stopped = denoise(tmp_path / "shot", out)
    assert (stopped.exit_code, "new frames" in stopped.output) == (130, again is not None)
    assert f"Images from frame {again} on are computed again" in stopped.output or again is None
    succeeded(denoise(tmp_path / "shot", out))
    assert_same(out, whole, range(COUNT))
    fewer = denoise(write_noisy(tmp_path / "shot", 7, cuts=(cut,)), out)
    assert "the shot had frames 0 to 11, has 7 of them" in fewer.output


def test_alpha_is_written_beside_the_colour(tmp_path: Path) -> None:
    shot = write_noisy(tmp_path / "shot", 4, aovs=True)
    assert denoise(shot, tmp_path / "out").exit_code == 0
    channels = read_exr(tmp_path / "out/0002.exr")
    np.testing.assert_allclose(channels["A"], channels["R"].clip(0.0, 1.0), atol=0.1)


@pytest.mark.parametrize(
    ("denoised", "channels", "installed", "per_frame", "denoiser"),
    [
        (False, (), False, "auto", "oidn"),  # which then says that it is missing
        (True, (), True, "auto", "none"),
        (True, ("V.Noisy Image.R",), True, "auto", "oidn"),
        (True, ("V.Noisy Image.R",), False, "auto", "none"),
        (True, ("V.Noisy Image.R",), True, "none", "none"),
        (True, (), False, "oidn", "oidn"),
    ],
)
def test_noise_is_denoised_where_the_frames_have_it_and_oidn_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, denoised: bool, channels: tuple[str, ...],
    installed: bool, per_frame: PerFrame, denoiser: str,
) -> None:  # fmt: skip
    shot = Shot.open(write_noisy(tmp_path / "shot", 1))
    shot.is_denoised, shot.noisy_channels = denoised, channels
    monkeypatch.setattr(denoise_run, "has_oidn", lambda: installed)
    assert denoise_run.DenoiseRun(shot=shot, output=tmp_path, per_frame=per_frame).denoiser == denoiser


def write_frames(folder: Path, numbers: Iterable[int]) -> Path:
    for number in numbers:
        frame = noisy(number)
        arrays = [np.asarray(frame.color), frame.depth[..., None], np.asarray(frame.motion)]
        pixels = np.concatenate(arrays, axis=2).astype(np.float32)
        write_exr(folder / f"{number:04d}.exr", pixels, [*"RGBZ", "vector.x", "vector.y"])
    return folder


def test_a_missing_frame_is_a_cut(tmp_path: Path) -> None:
    options = "--conventions", "supersampler"
    write_frames(tmp_path / "frames", (*range(5), *range(7, 12)))
    result = succeeded(denoise(tmp_path / "frames", tmp_path / "out", *options))
    assert "frame 5 to 6 between 0004.exr and 0007.exr is missing: a cut" in result.output
    there = sorted(path.name for path in (tmp_path / "out").glob("*.exr"))
    assert there == [f"{index:04d}.exr" for index in (*range(5), *range(7, 12))]
    succeeded(denoise(tmp_path / "frames", tmp_path / "part", *options, "--frames", "7-11"))
    assert_same(tmp_path / "part", tmp_path / "out", [7])
    none = denoise(tmp_path / "frames", tmp_path / "none", *options, "--frames", "5-6")
    assert "frame 5 to 6 between 0004.exr and 0007.exr is missing. Render it" in none.stderr
    assert (none.exit_code, (tmp_path / "none").exists()) == (1, False)
    beyond = denoise(tmp_path / "frames", tmp_path / "none", *options, "--frames", "3-12")
    assert "has no frame from 12 to 12. Its frames are 0 to 11." in beyond.stderr
    assert not (tmp_path / "none").exists()


def test_a_frame_that_was_missing_for_a_while_leaves_no_trace(tmp_path: Path) -> None:
    frames, out = write_frames(tmp_path / "frames", range(10)), tmp_path / "out"
    options = "--conventions", "supersampler"
    succeeded(denoise(frames, out, *options))
    whole = images(out)
    (frames / "0006.exr").rename(tmp_path / "0006.exr")
    assert "frame 6 between" in succeeded(denoise(frames, out, *options)).stderr
    assert images(out) != whole
    (tmp_path / "0006.exr").rename(frames / "0006.exr")
    succeeded(denoise(frames, out, *options))
    assert images(out) == whole


def test_a_sequence_with_thousands_of_gaps_is_split_into_its_parts(tmp_path: Path) -> None:
    first = write_frames(tmp_path / "frames", [0]) / "0000.exr"
    for number in range(2, 4000, 2):
        (tmp_path / f"frames/{number:04d}.exr").hardlink_to(first)
    shot = open_source(tmp_path / "frames", frames=(0, 0), conventions=Conventions())
    opened: list[tuple[int, int]] = []

    def open_frames(frames: tuple[int, int] | None = None) -> Shot:
        if frames is None:
            return open_source(tmp_path / "frames", conventions=Conventions())
        opened.append(frames)
        return shot  # quickly

    parts = [part for part, _, _ in denoise_run.parts_of(None, open_frames, passes=2)]
    assert parts == [FrameRange(number, number) for number in range(0, 4000, 2)]
    assert opened == [(number, number) for number in range(0, 4000, 2)]


@pytest.mark.parametrize(("compression", "border"), [("zip", 0), ("dwaa", 3)])
def test_ids_are_copied_as_they_are_with_their_names(tmp_path: Path, compression: str, border: int) -> None:
    ids = np.random.default_rng(0).random((30, 48), np.float32) * 1e6
    manifest = '{"a": "' + "0" * 9000 + '"}'
    entries = {
        "CryptoObject00": {"cryptomatte/1/name": "CryptoObject", "cryptomatte/1/manifest": manifest},
        "ProxyMask": {"cryptomatte/2/name": "ProxyMask"},
        "depth": {"cryptomatte/3/name": "Other.CryptoObject"},  # of another view layer
    }
    for index in range(3):
        frame, parts = noisy(index), []
        for name, letters, values in (
            ("rgba", "RGB", frame.color), ("depth", "Z", frame.depth), ("vector", "xy", frame.motion),
            ("CryptoObject00", "r", ids + index), ("ProxyMask", ["ProxyMask00.R"], ids - index),
            ("MeshID", "Y", ids),
        ):  # fmt: skip
            pixels = np.asarray(values, np.uint32 if name == "MeshID" else np.float32).reshape(30, 48, -1)
            pixels = pixels[:, border:]
            spec = ImageSpec(48 - border, 30, len(letters), "uint" if name == "MeshID" else "float")
            spec.x, spec.full_width, spec.full_height = border, 48, 30
            spec.channelnames = tuple(letters)
            spec.attribute("oiio:subimagename", name)
            for key, text in entries.get(name, {}).items():
                spec.attribute(key, text)
            parts.append((spec, pixels))
        write_parts(tmp_path / f"frames/{index:04d}.exr", *parts)
    options = "--conventions", "supersampler", "--compression", compression
    result = succeeded(denoise(tmp_path / "frames", tmp_path / "out", *options))
    channels = read_exr(tmp_path / "out/0001.exr")
    for name, stored in (("CryptoObject00.r", ids + 1), ("ProxyMask00.R", ids - 1)):
        np.testing.assert_array_equal(channels[name][:, border:], stored[:, border:])
        assert (channels[name][:, :border] == 0).all()
    assert channels["R"].dtype == np.float16
    assert "Copied, because they cannot be blended: CryptoObject00.r, ProxyMask00.R" in result.output
    assert "Not read, because they cannot be blended: MeshID.Y" in result.output
    stated = read_header(tmp_path / "out/0001.exr").cryptomatte
    assert stated == entries["CryptoObject00"] | entries["ProxyMask"]
    assert ("is zip: dwaa would change the copied ids" in result.output) == (compression == "dwaa")


def test_missing_guides_and_missing_motion_are_said_once(tmp_path: Path) -> None:
    color, still = np.random.default_rng(0).random((90, 160, 3)), np.zeros((90, 160, 2), np.float32)
    with ShotWriter(tmp_path / "shot", name="shot", display_size=None, frame_rate=24.0) as writer:
        for index in range(3):
            moved = np.roll(color, 3 * index, axis=1).astype(np.float32)
            writer.write(noisy(index, size=(160, 90), color=moved, motion=still, gbuffer=None))
    result = succeeded(denoise(tmp_path / "shot", tmp_path / "out"))
    assert result.output.count("The frames have no albedo and no normal") == 1
    assert result.output.count("frame 1: frame.motion is 0 everywhere, although the image moves") == 1
    assert result.output.count("warning") == 1


def test_samples_are_an_option_and_a_setting_of_the_run(tmp_path: Path) -> None:
    shot, images = write_noisy(tmp_path / "shot", 3), []
    for samples in ("1", "100"):
        result = succeeded(denoise(shot, tmp_path / "out", "--samples", samples, "--overwrite"))
        images.append(read_exr(tmp_path / "out/0001.exr")["R"])
    assert (images[0] != images[1]).any()
    result = denoise(shot, tmp_path / "out", "--samples", "100", "--passes", "1")
    assert "images of another run are there: frames after was 5, is now 0" in result.output
    result = denoise(shot, tmp_path / "out", "--samples", "0")
    assert result.exit_code == 2
    assert "samples is 0.0; want a number above 0" in result.output


def test_the_frame_that_cannot_be_denoised_is_named(tmp_path: Path) -> None:
    with ShotWriter(tmp_path / "shot", name="shot", display_size=(48, 30), frame_rate=24.0) as writer:
        for index in range(4):
            writer.write(noisy(index, jitter=(0.25, 0.0) if index == 2 else (0.0, 0.0)))
    result = denoise(tmp_path / "shot", tmp_path / "out")
    assert result.exit_code == 1
    assert "frame 2: frame.jitter is (0.25, 0.0); want (0, 0) in every frame" in said(result)


def test_frames_that_are_not_denoised_need_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    shot = write_noisy(tmp_path / "shot", 2)
    result = run("denoise", shot, "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert result.output.strip().endswith('pip install "supersampler[denoise]"')
    assert not (tmp_path / "out").exists()
