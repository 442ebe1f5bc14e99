"""Unshaded frames between shaded ones: their light from both sides."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from supersampler import ArgumentError, Frame, FrameError, Shot, Upscaler, upscale_sequence
from supersampler.io.shot import ShotWriter
from supersampler.sequence import both_ways
from supersampler.sequence.interpolation import (
    MIN_AGREEMENT,
    Interpolator,
    Side,
    interpolated,
    surface_agreement,
)
from upscale_runs import DISPLAY_SIZE, SIZE, moving, pixels, upscale

COUNT = 7


def lit(index: int, *, light: float, shaded: bool = True, **overrides: Any) -> Frame:
    """A textured wall under a light, with the buffers of guided-warp."""
    frame = moving(index)
    base = np.asarray(frame.color, np.float32) / (1.0 + np.asarray(frame.color, np.float32))
    normal = np.zeros((SIZE[1], SIZE[0], 3), np.float32)
    normal[..., 2] = 1.0
    color = (base + np.float32(0.02)) * np.float32(light) if shaded else None
    buffers = {"base_color": base, "normal": normal}
    return replace(frame, color=color, gbuffer=buffers, exposure=1.0, **overrides)


def alternating(count: int = COUNT) -> list[Frame]:
    """The light doubles in four frames; every second frame is unshaded."""
    return [lit(i, light=2.0 ** (i / 4), shaded=i % 2 == 0, reset=i == 0) for i in range(count)]


def images(frames: Any, passes: int) -> list[np.ndarray]:
    options: dict[str, Any] = {"display_size": DISPLAY_SIZE, "model": "bilinear", "passes": passes}
    return list(upscale_sequence(frames, extrapolation="guided-warp", validate="off", **options))


def test_light_that_changes_is_that_between_the_shaded_frames() -> None:
    one, two = images(alternating(), 1), images(alternating(), 2)
    inner = slice(8, -8), slice(8, -8)
    for index in range(1, COUNT - 1, 2):
        truth = upscaled(lit(index, light=2.0 ** (index / 4)))[inner].mean()
        assert two[index][inner].mean() == pytest.approx(truth, rel=0.03)
        assert one[index][inner].mean() < 0.9 * truth  # the light of the frame before


def upscaled(frame: Frame) -> np.ndarray:
    return Upscaler("bilinear", display_size=DISPLAY_SIZE, validate="off").step(frame)


def test_shaded_frames_are_as_if_all_were_shaded_where_a_method_has_no_history() -> None:
    two = images(alternating(), 2)
    for index in range(0, COUNT, 2):
        alone = upscaled(lit(index, light=2.0 ** (index / 4)))
        np.testing.assert_allclose(two[index], alone, rtol=1e-5, atol=1e-6)


def test_the_last_frame_takes_its_light_from_the_frame_before() -> None:
    one, two = images(alternating(6), 1), images(alternating(6), 2)
    np.testing.assert_allclose(two[5], one[5], rtol=1e-4, atol=1e-5)


def test_chunks_do_not_change_the_images(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = images(alternating(), 2)
    monkeypatch.setattr(both_ways.ChunkSize, "__new__", lambda cls: tuple.__new__(cls, (3, 2)))
    for a, b in zip(images(alternating(), 2), whole, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-5)


def test_the_first_frame_after_a_cut_must_be_shaded() -> None:
    frames = alternating(4)
    frames[2] = lit(2, light=1.0, shaded=False, reset=True)
    with pytest.raises(FrameError, match="Shade the first frame after a cut"):
        images(frames, 2)


def test_the_side_that_saw_the_surface_counts() -> None:
    shape = (2, 2)
    seen, unseen = np.ones(shape, np.float32), np.full(shape, MIN_AGREEMENT, np.float32)
    dark, bright = np.zeros((*shape, 3), np.float32), np.ones((*shape, 3), np.float32)
    assert interpolated(Side(dark, seen, 1), Side(bright, unseen, 1)).max() < 0.01
    assert interpolated(Side(dark, seen, 1), Side(bright, seen, 3)).mean() == pytest.approx(0.25)


def test_a_surface_that_moved_agrees_where_it_was_and_not_off_screen() -> None:
    now, before = lit(1, light=1.0, shaded=False), lit(0, light=1.0)
    arrays = {**(before.gbuffer or {}), "depth": before.depth[..., None], "motion": now.motion}
    history = {f"history.{name}": np.moveaxis(array, -1, 0)[None] for name, array in arrays.items()}
    history["history.jitter"] = np.array([before.jitter], np.float32)
    assert np.median(surface_agreement(now, history)) > 0.5
    away = {**history, "history.motion": history["history.motion"] + np.float32(100.0)}
    assert (surface_agreement(now, away) == MIN_AGREEMENT).all()


def test_the_command_takes_both_options(tmp_path: Path) -> None:
    with ShotWriter(tmp_path / "shot", name="s", display_size=DISPLAY_SIZE, frame_rate=24) as writer:
        for frame in alternating(5):
            writer.write(frame)
    upscale(tmp_path / "shot", tmp_path / "out", "--passes", 2, "--extrapolate", "guided-warp")
    for index, image in enumerate(images(Shot.open(tmp_path / "shot"), 2)):
        stored = pixels(tmp_path / "out" / f"{index:04d}.exr")
        np.testing.assert_array_equal(stored, image.astype(np.float16).astype(np.float32))


def test_a_model_without_surfaces_is_refused() -> None:
    class Bare:
        info = SimpleNamespace(method="bare", history=())

    with pytest.raises(ArgumentError, match="'bare', without history"):
        Interpolator(Bare(), ())  # type: ignore[arg-type]
