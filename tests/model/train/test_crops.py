"""Crops give the same samples as the whole frame, at any ratio and with any augmentation."""

import dataclasses
import itertools

import numpy as np
import pytest
import torch

from supersampler import halton_jitter
from supersampler_model import ops
from supersampler_model.data.dataset import TrainingFrame
from supersampler_model.data.scenes.analytic import DiscOverPlane
from supersampler_model.methods.classifier import Classifier
from supersampler_model.training.classifier_tasks import ClassifierTask
from supersampler_model.training.crops import FIREFLY_CHANCE, CropRegion, with_fireflies
from supersampler_model.training.datasets import frame_inputs

DISPLAY = (96, 64)
FRAMES = 3


def frames(render: tuple[int, int]) -> list[TrainingFrame]:
    scene = DiscOverPlane(start=(22.0, 14.0))
    made = []
    for index in range(FRAMES):
        x, y = halton_jitter(index, DISPLAY[0] / render[0])
        frame = scene.frame(index, render, (x + 0.013, y - 0.007))  # on no sample: ties are not symmetric
        assert frame.color is not None
        blank = np.zeros(DISPLAY[::-1], np.uint8)
        made.append(
            TrainingFrame(
                color=frame.color.astype(np.float16),
                depth=frame.depth,
                motion=frame.motion.astype(np.float16),
                jitter=frame.jitter,
                reset=index == 0,
                exposure=1.0,
                reference=np.zeros((*DISPLAY[::-1], 3), np.float16),
                ghost=blank,
                alias=blank,
            )
        )
    return made


def whole(sequence: list[TrainingFrame]) -> torch.Tensor:
    method = Classifier().eval()
    history = method.first_history(ops.Size(*DISPLAY), ops.Size(*sequence[0].depth.shape[::-1]))
    for frame in sequence:
        with torch.no_grad():
            image, history, _ = method.step(*frame_inputs(frame, method.inputs()).values(), *history)
    shown: torch.Tensor = image
    return shown


def cropped(sequence: list[TrainingFrame], cut: CropRegion) -> torch.Tensor:
    task = ClassifierTask(Classifier().eval())
    states = [task.first_state(cut.cut(sequence[0], reset=True))]
    for frame in sequence:
        with torch.no_grad():
            stepped = task.step([cut.cut(frame, reset=frame.reset)], states)
        states = stepped.states
    return stepped.images


@pytest.mark.parametrize("render", [(96, 64), (64, 43), (48, 32), (32, 21)])
def test_crops_at_all_places_of_a_frame_read_as_many_samples(render: tuple[int, int]) -> None:
    frame, size = frames(render)[0], 40
    ratio = DISPLAY[0] / render[0], DISPLAY[1] / render[1]
    shapes = set()
    for left, top in itertools.product(range(DISPLAY[0] - size + 1), range(DISPLAY[1] - size + 1)):
        shapes.add(CropRegion(left=left, top=top, size=size, ratio=ratio).cut(frame, reset=True).color.shape)
    assert len(shapes) == 1


@pytest.mark.parametrize(
    ("render", "flip", "turned"),
    [
        ((96, 64), (False, False), False),
        ((64, 43), (True, False), True),
        ((48, 32), (False, True), False),
        ((48, 32), (True, True), True),
        ((32, 21), (False, False), True),
    ],
)
def test_a_crop_renders_the_part_of_the_whole_image(
    render: tuple[int, int], flip: tuple[bool, bool], turned: bool
) -> None:
    sequence = frames(render)
    ratio = DISPLAY[0] / render[0], DISPLAY[1] / render[1]
    cut = CropRegion(left=31, top=9, size=40, ratio=ratio, flip=flip, turned=turned)
    part = whole(sequence)[:, :, 9:49, 31:71]
    part = part.flip(3) if flip[0] else part
    part = part.flip(2) if flip[1] else part
    part = part.transpose(2, 3) if turned else part
    inside = np.s_[:, :, 12:-12, 12:-12]  # pixels whose history lies within the crop
    assert torch.allclose(cropped(sequence, cut)[inside], part[inside], atol=1e-3)


def test_a_gain_of_the_colours_alone_scales_the_image() -> None:
    sequence = frames((48, 32))
    cut = CropRegion(left=31, top=9, size=40, ratio=(2.0, 2.0))
    brighter = dataclasses.replace(cut, gain=4.0)
    assert torch.allclose(cropped(sequence, brighter), 4.0 * cropped(sequence, cut), rtol=1e-3, atol=1e-4)


def test_fireflies_strike_a_few_frames_in_colour_alone_and_stay_in_range() -> None:
    frame = frames((48, 32))[0]
    sample = CropRegion(left=31, top=9, size=40, ratio=(2.0, 2.0)).cut(frame, reset=True)
    made = [with_fireflies(sample, np.random.default_rng(seed)) for seed in range(400)]
    struck = [other for other in made if not torch.equal(other.color, sample.color)]
    assert 0.5 * FIREFLY_CHANCE < len(struck) / len(made) < 2.0 * FIREFLY_CHANCE
    for other in struck:
        bright = other.color > sample.color
        assert bright.all(dim=1).sum() == bright.any(dim=1).sum(), "of all channels"
        assert 0.0 < bright.float().mean() < 0.2
        assert other.color.max() <= 65504.0
        assert torch.equal(other.reference, sample.reference)
