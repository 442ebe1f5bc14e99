"""Training of `guided-flow` on unshaded frames, whose light is computed once and cached."""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import cast

import numpy as np
import pytest
import torch

import gbuffer_sets
from flow_method import SMALL, Shadow, random_flow
from gbuffer_sets import gbuffer_data, training_frame
from supersampler import ArgumentError
from supersampler_model import ops
from supersampler_model.data.dataset.storage import Dataset, SequenceEntry, TrainingFrame
from supersampler_model.data.labels import Ghost
from supersampler_model.methods.base import load_trained
from supersampler_model.methods.guided_flow import GuidedFlow
from supersampler_model.training import flow_task
from supersampler_model.training.datasets import method_inputs
from supersampler_model.training.task import start_task
from supersampler_model.training.validation import validate, validation_entries
from torch_inputs import step_by_name
from upscale_runs import run, succeeded

pytest_plugins = ["training_fixtures"]

SIZE = 16


@pytest.fixture(scope="module")
def dataset(data: Dataset) -> Dataset:
    return flow_task.FlowTask(random_flow()).data(data)


class Shown:
    """A set of one sequence, made of frames at hand."""

    folder = Path("shown")

    def __init__(self, frames: Sequence[TrainingFrame]) -> None:
        self._frames = frames

    def frames(self, entry: object) -> Iterator[TrainingFrame]:
        del entry
        return iter(self._frames)


def found_of(method: GuidedFlow, frames: Sequence[TrainingFrame]) -> flow_task.LightFrames:
    entry = cast(SequenceEntry, frames[0].color.shape)  # any key
    return flow_task.LightCache(method).of(cast(Dataset, Shown(frames)), entry)


def shadow(count: int, speed: float = 3.0, edge: float = 24.0) -> list[TrainingFrame]:
    scene = Shadow(speed, edge=edge)
    frames = (scene.frame(index) for index in range(count))
    return [training_frame(frame, np.asarray(frame.color)) for frame in frames]


def whole(found: flow_task.LightFrames, index: int) -> flow_task.LightCrop:
    """A found frame, neither cut nor turned."""
    later, earlier = torch.split(found.half[index : index + 1].float(), flow_task.HALF_CHANNELS, dim=1)
    light, guides, reflects, color, changed = torch.split(
        found.full[index : index + 1].float(), flow_task.FULL_CHANNELS, dim=1
    )
    earlier = torch.cat([earlier, later[:, 3:]], dim=1)
    return flow_task.LightCrop(later, earlier, light, guides, reflects, color, changed, torch.ones(1))


# --- what is found ---


def test_light_is_computed_for_each_pattern_of_unshaded_frames() -> None:
    method = random_flow()
    with pytest.raises(ArgumentError, match="4 frames without a cut"):
        found_of(method, shadow(3))
    assert len(found_of(method, shadow(4)).full) == 1  # s u s [u]
    # s u s [u] s [u] s; from the second on: s u s [u] s [u]; s u u s [u] [u] s
    found = found_of(method, shadow(7))
    assert found.full.shape == (6, sum(flow_task.FULL_CHANNELS), 36, 64)
    assert found.half.shape == (6, sum(flow_task.HALF_CHANNELS), 18, 32)


def test_no_light_is_computed_across_a_cut() -> None:
    frames = shadow(8)
    frames[4] = replace(frames[4], reset=True)
    found = found_of(random_flow(), frames)
    assert len(found.full) == 3  # s u s [u] | s u s [u]; from the second on: s u s | s u s [u]


def test_unshaded_frames_are_extrapolated_as_the_method_does() -> None:
    method = random_flow()
    frames = shadow(5)
    found = found_of(method, frames)
    names = ["color", *method.inputs()]
    given = [method_inputs(frame, names) for frame in frames]
    state = step_by_name(method, given[1], method.after_shaded(given[0])).history
    image = step_by_name(method, given[3], method.after_shaded(given[2], state)).image
    with torch.no_grad():
        stepped = flow_task.FlowTask(method).step([whole(found, 0)], [[]])
    assert (stepped.images - image).abs().max() < 0.02  # half floats
    assert torch.equal(whole(found, 0).reference, given[3]["color"].half().float())


def test_classes_are_those_of_the_pixel_that_a_sample_lies_in(dataset: Dataset) -> None:
    frame = dataset.read(dataset.entries("train")[0], 0)
    ghost = np.zeros_like(frame.ghost)
    ghost[6, 11] = Ghost.SHADING  # of 36 x 64; samples are of 18 x 32
    for jitter, expected in (((0.25, -0.25), 1), ((-0.25, -0.25), 0), ((0.25, 0.25), 0)):
        changed = flow_task.changing_light(replace(frame, ghost=ghost, jitter=jitter))[0, 0]
        assert changed.shape == (18, 32)
        assert changed.sum() == expected
        assert bool(changed[3, 5]) == bool(expected)


# --- crops ---


@pytest.mark.parametrize("seed", range(8))
def test_in_a_crop_half_size_pixels_are_the_first_of_each_two_however_it_is_turned(seed: int) -> None:
    found = found_of(random_flow(), shadow(4))
    sample = flow_task.draw_light(np.random.default_rng(seed), found, 12)
    assert sample.light.shape[2:] == (24, 24)
    toned = sample.later[:, :3]
    light = toned / (1.0 - toned.amax(dim=1, keepdim=True))
    share = light / sample.light[:, :, ::2, ::2]  # the exposure of what the network sees
    torch.testing.assert_close(share, share.mean().expand_as(share), rtol=0.01, atol=0.0)


def test_crops_are_of_one_frame_and_mostly_of_those_whose_light_changes() -> None:
    full = torch.zeros(3, sum(flow_task.FULL_CHANNELS), 40, 40)
    full[1, -1] = 1.0
    frames = flow_task.LightFrames(torch.zeros(3, sum(flow_task.HALF_CHANNELS), 20, 20), full)
    crops = [flow_task.draw_light(np.random.default_rng(seed), frames, 12) for seed in range(40)]
    assert {crop.changed.shape for crop in crops} == {(1, 1, 24, 24)}
    assert sum(bool(crop.changed.all()) for crop in crops) > 30


def test_a_restarted_stream_continues(dataset: Dataset) -> None:
    lights = flow_task.LightCache(random_flow())
    stream = flow_task.LightStream([dataset], lights, ratio=2, size=SIZE, seed=[4])
    for sample in islice(stream, 5):
        again = flow_task.LightStream([dataset], lights, ratio=2, size=SIZE, seed=[4])
        again.position = replace(stream.position, crop=stream.position.crop - 1)
        assert torch.equal(next(iter(again)).light, sample.light)


def test_a_crop_as_large_as_a_frame_or_too_small_for_the_network_is_refused(dataset: Dataset) -> None:
    with pytest.raises(ArgumentError, match="at most 16"):
        flow_task.LightStream([dataset], flow_task.LightCache(random_flow()), ratio=2, size=18, seed=[0])
    with pytest.raises(ArgumentError, match="more than 32"):
        flow_task.FlowTask(GuidedFlow()).stream([dataset], size=32, seed=[0])


# --- learning ---


def test_gradients_reach_all_weights_and_crops_of_a_batch_do_not_mix() -> None:
    task = flow_task.FlowTask(random_flow())
    one, two = (whole(found_of(task.method, shadow(4, *s)), 0) for s in ((3.0,), (-2.0, 40.0)))
    both, alone = task.step([one, two], [[], []]), task.step([two], [[]])
    torch.testing.assert_close(both.images[1:], alone.images, rtol=1e-3, atol=1e-3)
    both.images.mean().backward()  # type: ignore[no-untyped-call]
    assert [n for n, p in task.method.named_parameters() if p.grad is None or not p.grad.any()] == []


def test_errors_where_the_light_changed_weigh_more() -> None:
    task = flow_task.FlowTask(random_flow())
    crop = whole(found_of(task.method, shadow(4)), 0)
    changed = torch.zeros_like(crop.changed)
    changed[..., :10] = 1.0
    weight = task.step([crop._replace(changed=changed)], [[]]).weight
    assert isinstance(weight, torch.Tensor)
    assert task.losses.changed > 0.0
    assert set(weight[..., :10].flatten().tolist()) == {1.0 + task.losses.changed}
    assert set(weight[..., 10:].flatten().tolist()) == {1.0}


def test_the_flow_network_learns_how_a_shadow_moves() -> None:
    torch.manual_seed(0)
    task = flow_task.FlowTask(GuidedFlow(SMALL))
    samples = [whole(found_of(task.method, shadow(4, speed)), 0) for speed in (3.0, 2.0)]
    optimizer = torch.optim.Adam(task.method.parameters(), lr=1e-2)
    errors = []
    for _ in range(60):
        stepped = task.step(samples, [[], []])
        off = (stepped.images - torch.cat([s.reference for s in samples])).abs().mean()
        errors.append(float(off.detach()))
        optimizer.zero_grad()
        off.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
    assert min(errors[-5:]) < 0.6 * errors[0]


# --- runs ---


def test_validation_hides_every_second_frame(dataset: Dataset) -> None:
    task = flow_task.FlowTask(random_flow())
    entries = validation_entries([dataset], task.ratios)
    frames, runner = list(dataset.frames(entries[0][1])), task.runner(task.baseline.eval(), ops.Size(64, 36))
    results = [runner.step(frame) for frame in frames]
    assert [i for i, image in enumerate(results) if image is not None] == [1, 3, 5, 7, 9]
    for frame, image in zip(frames, results, strict=True):
        assert image is None or image.shape[2:] == runner.truth(frame).shape[:2] == (18, 32)
    found = validate(task.baseline.eval(), entries, task.runner)
    assert list(found.scores) == ["psnr"]
    assert found.psnr > 25.0  # all light is even there
    assert validate(GuidedFlow().eval(), entries, task.runner).psnr == pytest.approx(found.psnr)


def test_a_run_writes_weights_and_reports_the_comparison(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gbuffer_sets, "DISPLAY", (160, 90))
    gbuffer_data(tmp_path / "set")
    arguments = ["train", "guided-flow", "--data", tmp_path / "set", "-o", tmp_path / "run", "--size", 36]
    more = ["--batch", 1, "--frames", 2, "--every", 1]
    succeeded(run(*arguments, *more, "--steps", 2))
    with (tmp_path / "run" / "log.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["step"] for row in rows] == ["1.0", "2.0"]
    assert {"image", "psnr", "psnr_guided-warp"} <= rows[0].keys()
    assert "tpsnr" not in rows[0]
    trained = load_trained(tmp_path / "run" / "weights.safetensors")
    assert start_task("guided-flow", trained).method.provenance["steps"] == 2
