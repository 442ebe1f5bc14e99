"""What stands still on the GPU is what stands still in torch: decisions, means, images, frozen pixels."""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
import torch

from gpu_steps import device_or_skip
from supersampler import Frame, halton_jitter
from supersampler.backends.gpu.executor import GpuExecutor
from supersampler.backends.gpu.history import GpuHistory
from supersampler.frame import Float32, Size
from supersampler.io.display import display_transform
from supersampler.methods.at_rest import NOISY
from supersampler.methods.gpu_backends import gpu_program
from supersampler.methods.model_file import read_upscaling_info
from supersampler_model.methods.base import Method
from supersampler_model.methods.taau.model import Taau

RENDER, DISPLAY = (22, 14), (44, 28)
PERIOD = 32
MEAN, LARGEST = 1e-3, 1.0 / 255.0
QUANTILE = 0.999


@pytest.fixture(scope="module", autouse=True)
def device() -> Any:
    return device_or_skip()


class Given(NamedTuple):
    """A frame of a sequence."""

    frame: Frame
    adds_samples: float = 1.0


def scene(x: Any, y: Any) -> Float32:
    """Linear RGB at places of a unit square: shades, edges, and a fine pattern."""
    shade = 0.4 + 0.3 * np.sin(9.0 * x + 4.0 * y)
    edge = np.where((x - 0.5) * 0.8 + (y - 0.45) * 1.7 > 0.0, 0.9, 0.2)
    pattern = np.where(np.floor(13.0 * x) % 2 == 0, 1.2, 0.3)
    return np.stack([shade, edge, np.where(y > 0.6, pattern, 0.5 * shade)], -1).astype(np.float32)


def frame_at(
    index: int,
    render: Size = RENDER,
    *,
    period: int = PERIOD,
    ratio: float = 2.0,
    light: Any = 1.0,
    **fields: Any,
) -> Frame:
    """A static scene, sampled with jitter; `light` multiplies its colour, a number or (h, w, 1)."""
    jitter = halton_jitter(index % period, ratio)
    y, x = np.mgrid[: render[1], : render[0]]
    place = (x + 0.5 + jitter[0]) / render[0], (y + 0.5 + jitter[1]) / render[1]
    given: dict[str, Any] = {
        "color": scene(*place) * np.float32(light),
        "depth": np.full(render[::-1], 0.5, np.float32),
        "motion": np.zeros((*render[::-1], 2), np.float32),
        "jitter": jitter,
        "exposure": 1.0,
    }
    return Frame(**{**given, **fields})


@cache
def executor(method: str) -> GpuExecutor:
    program = gpu_program(read_upscaling_info(method))
    assert program is not None
    return GpuExecutor(program)


class OnGpu:
    """Steps of the GPU backend on two sets of buffers, as `Upscaler` takes them."""

    def __init__(self, method: str, display: Size, *, skip: bool = True) -> None:
        self.executor, self.display, self.skip = executor(method), display, skip
        self.history: GpuHistory | None = None
        self.spare: GpuHistory | None = None

    def step(self, given: Given) -> tuple[Float32, Float32 | None]:
        """Return image and `converged`, which is None where the method is skipped."""
        frame, gpu = given.frame, self.executor
        if self.history is None or frame.reset:
            self.history = gpu.zeros(self.display, frame.size)
        if self.spare is None or not self.spare.fits(self.display, frame.size):
            self.spare = gpu.zeros(self.display, frame.size)
        image = np.empty((*self.display[::-1], 3), np.float32)
        wanted = () if self.skip else ("weight", "converged")
        found = gpu.step(
            frame, self.display, self.history, self.spare, image, wanted,
            adds_samples=given.adds_samples, skip=self.skip,
        )  # fmt: skip
        before, self.history, self.spare = self.history, self.spare, None
        self.spare = before if before.fits(self.display, frame.size) else None
        return image, found["converged"][0, 0] if wanted else None

    def tensor(self, name: str) -> Float32:
        assert self.history is not None
        return self.executor.tensor(self.history, name)


class InTorch:
    """Steps of the module, from the same constants."""

    def __init__(self, method: Method, display: Size) -> None:
        self.method, self.display = method, display
        self.history: dict[str, torch.Tensor] | None = None

    def step(self, given: Given) -> tuple[Float32, Float32]:
        frame = given.frame
        if self.history is None or frame.reset:
            zeros = self.method.first_history(self.display, frame.size)
            self.history = dict(zip(self.method.history, zeros, strict=True))
        reactive = np.zeros(frame.size[::-1]) if frame.reactive is None else np.asarray(frame.reactive)
        values = {
            "color": planes(frame.color),
            "depth": planes(np.asarray(frame.depth)[..., None]),
            "motion": planes(frame.motion),
            "reactive": planes(reactive[..., None]),
            "jitter": torch.tensor([frame.jitter]),
            "exposure": torch.tensor([frame.exposure or 0.0]),
            "pre_exposure": torch.tensor([frame.pre_exposure]),
            "display_size": torch.tensor(self.display),
            "adds_samples": torch.tensor([given.adds_samples]),
        }
        with torch.no_grad():
            arguments = [values[name] for name in self.method.inputs()]
            done = self.method.step(*arguments, *self.history.values())
        self.history = dict(zip(self.method.history, done.history, strict=True))
        return done.image[0].permute(1, 2, 0).numpy(), done.aux_outputs[-1][0, 0].numpy()

    def tensor(self, name: str) -> Float32:
        assert self.history is not None
        return self.history[name].numpy()


def planes(image: Any) -> torch.Tensor:
    return torch.from_numpy(np.asarray(image, np.float32)).permute(2, 0, 1)[None].contiguous()


def shown(image: Float32, exposure: float | None = None) -> Float32:
    return display_transform(image, exposure or 1.0)


def compare_steps(
    sequence: Sequence[Given],
    display: Size = DISPLAY,
    *,
    skip: bool = False,
    largest: float = LARGEST,
    decisions: float = 1.0,
) -> tuple[OnGpu, list[float]]:
    """Step both through a sequence and compare what each step gives; return frozen parts of the image.

    `decisions` is the least part of blocks that are decided alike in each frame.
    """
    ours, theirs = OnGpu("taau", display, skip=skip), InTorch(Taau(), display)
    frozen = []
    for index, given in enumerate(sequence):
        (image, converged), (wanted, stands) = ours.step(given), theirs.step(given)
        text = f"frame {index}"
        found, known = ours.tensor("static_blocks"), theirs.tensor("static_blocks")
        same = (found[:, 0] == known[:, 0]).mean()
        assert same >= decisions, f"{text}: {found[0, 0]} {known[0, 0]}"
        np.testing.assert_array_equal(ours.tensor("phases"), theirs.tensor("phases"), text)
        if converged is not None and decisions == 1.0:
            np.testing.assert_array_equal(converged, stands, text)
        if decisions == 1.0:
            np.testing.assert_allclose(found[:, 1:], known[:, 1:], rtol=1e-3, atol=2e-3, err_msg=text)
            ours_mean, mean = ours.tensor("static_mean")[0], theirs.tensor("static_mean")[0]
            np.testing.assert_allclose(ours_mean[3], mean[3], rtol=1e-4, atol=1e-4, err_msg=text)
            off = np.abs(shown_planes(ours_mean) - shown_planes(mean)) * (mean[3] > 1e-3)
            assert off.max() <= largest, text
        off = np.abs(shown(image) - shown(wanted))
        assert off.mean() <= MEAN, text
        assert np.quantile(off, QUANTILE) <= largest, text
        assert off.max() <= 4.0 * largest, text
        frozen.append(float(stands.mean()))
    return ours, frozen


def shown_planes(mean: Float32) -> Float32:
    return shown(np.ascontiguousarray(mean[:3].transpose(1, 2, 0))).transpose(2, 0, 1)


def still(frames: int, *args: Any, **options: Any) -> list[Given]:
    return [Given(frame_at(index, *args, **options)) for index in range(frames)]


def test_a_still_scene_freezes_as_in_torch_borders_included() -> None:
    _, frozen = compare_steps(still(2 * PERIOD + 8))
    assert frozen[2 * PERIOD - 2] == 0.0
    assert frozen[-1] > 0.8
