"""`guided-flow` learns from frames that are hidden from it, at the size that they were rendered at."""

import csv
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

import gbuffer_sets
from flow_method import SMALL, Shadow, random_flow
from gbuffer_sets import gbuffer_data
from supersampler.cli import app
from supersampler.errors import ArgumentError
from supersampler.graph_session import frame_inputs
from supersampler_model.data.dataset import Dataset
from supersampler_model.data.labels import Ghost
from supersampler_model.method import Size
from supersampler_model.methods.guided_flow import GuidedFlow
from supersampler_model.methods.guided_warp import GuidedWarp
from supersampler_model.sampling import View
from supersampler_model.train.flow_task import FlowTask
from supersampler_model.train.flow_windows import FlowCut, at_render_size, flow_stream
from supersampler_model.train.losses import census
from supersampler_model.train.task import State, Stepped
from supersampler_model.train.tasks import TASKS
from supersampler_model.train.validate import validate, validation_entries
from supersampler_model.train.windows import Sample
from supersampler_model.trained import load_trained

SIZE = 16


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return FlowTask(random_flow()).data(gbuffer_data(tmp_path_factory.mktemp("set")))


def samples_of(scene: Shadow, pattern: str) -> list[Sample]:
    """Frames of a scene as a stream hands them out; "u" is hidden."""
    made = []
    for index, kind in enumerate(pattern):
        frame = scene.frame(index)
        names = ("color", "depth", "motion", "gbuffer_base_color", "gbuffer_normal", "gbuffer_roughness")
        there = {n: torch.from_numpy(a) for n, a in frame_inputs(frame, frame.size, names).items()}
        color, classes = there["color"], torch.zeros(1, 36, 64, dtype=torch.int64)
        made.append(
            Sample(
                color=color, depth=there["depth"], motion=there["motion"], exposure=torch.ones(1),
                view=View(Size(64, 36), Size(64, 36), torch.zeros(1, 2)), reset=index == 0,
                reference=color if kind == "u" else torch.full_like(color, torch.nan),
                ghost=classes, alias=classes, gbuffer=there, hidden=kind == "u",
            )
        )  # fmt: skip
    return made


def walked(task: FlowTask, samples: list[Sample]) -> tuple[Stepped, State]:
    """The last frame's step, and what was left before it."""
    state = task.first_state(samples[0])
    for sample in samples[:-1]:
        state = task.step([sample], [state]).states[0]
    return task.step([samples[-1]], [state]), state


# --- crops ---


def test_a_crop_is_a_part_of_what_was_rendered_and_its_truth_is_its_colour(dataset: Dataset) -> None:
    frame = dataset.read(dataset.entries("train")[0], 3)
    sample = FlowCut(left=5, top=2, size=12, ratio=(1.0, 1.0)).sample(frame, reset=False)
    assert frame.gbuffer is not None
    for got, want in (
        (sample.color, frame.color),
        (sample.reference, frame.color),
        (sample.gbuffer["gbuffer_normal"], frame.gbuffer["normal"]),
    ):
        np.testing.assert_array_equal(got[0].numpy().transpose(1, 2, 0), want[2:14, 5:17].astype(np.float32))
    assert sample.view.jitter[0].tolist() == pytest.approx(frame.jitter)
    assert all(value.shape[2:] == (12, 12) for value in sample.gbuffer.values())
    turned = FlowCut(left=5, top=2, size=12, ratio=(1.0, 1.0), flip=(True, False), turned=True)
    x, y = turned.sample(frame, reset=False).view.jitter[0].tolist()
    assert (x, y) == pytest.approx((frame.jitter[1], -frame.jitter[0]))


def test_classes_are_those_of_the_pixel_that_a_sample_lies_in(dataset: Dataset) -> None:
    frame = dataset.read(dataset.entries("train")[0], 0)
    ghost = np.zeros_like(frame.ghost)
    ghost[6, 11] = Ghost.SHADING  # of 36 x 64; samples are of 18 x 32
    for jitter, expected in (((0.25, -0.25), 1), ((-0.25, -0.25), 0), ((0.25, 0.25), 0)):
        small = at_render_size(replace(frame, ghost=ghost, jitter=jitter))
        assert small.ghost.shape == (18, 32)
        assert (small.ghost == Ghost.SHADING).sum() == expected
        assert (small.ghost[3, 5] == Ghost.SHADING) == bool(expected)


def test_every_second_or_two_of_three_frames_are_hidden_the_same_after_a_restart(dataset: Dataset) -> None:
    seed, kinds = [4], set[str]()
    whole = flow_stream([dataset], ratio=2, size=SIZE, seed=seed)
    window = -1
    pattern = ""
    for sample in islice(whole, 200):
        assert sample.hidden == bool(sample.reference.isfinite().all())
        if whole.place.window != window:
            kinds.add(pattern[:5])
            window, pattern = whole.place.window, ""
        pattern += "u" if sample.hidden else "s"
        again = flow_stream([dataset], ratio=2, size=SIZE, seed=seed)
        again.place = replace(whole.place, frame=whole.place.frame - 1)
        other = next(iter(again))
        assert torch.equal(other.color, sample.color)
        assert other.hidden == sample.hidden or other.reset
    assert kinds == {"", "susus", "suusu"}


def test_a_crop_larger_than_a_frame_or_too_small_for_the_network_is_refused(dataset: Dataset) -> None:
    with pytest.raises(ArgumentError, match="at most 18"):
        flow_stream([dataset], ratio=2, size=20, seed=[0])
    with pytest.raises(ArgumentError, match="more than 32"):
        FlowTask(GuidedFlow()).stream([dataset], size=32, seed=[0])


# --- learning ---


def test_shaded_frames_are_left_as_they_are_and_cost_nothing() -> None:
    task, samples = FlowTask(random_flow()), samples_of(Shadow(3.0), "sus")
    stepped, state = walked(task, samples)
    assert torch.equal(stepped.images, samples[2].color)
    expected = GuidedFlow.after_shaded({**samples[2].gbuffer, "jitter": samples[2].view.jitter}, state)
    for got, want in zip(stepped.states[0], expected, strict=True):
        assert torch.equal(got, want)
    sum(stepped.terms.values(), torch.zeros(())).backward()  # type: ignore[no-untyped-call]
    assert all(p.grad is not None and not p.grad.any() for p in task.method.parameters())


def test_hidden_frames_are_drawn_as_the_method_draws_them() -> None:
    task, samples = FlowTask(random_flow()), samples_of(Shadow(3.0), "susuu")
    with torch.no_grad():
        stepped, state = walked(task, samples)
        inputs = {**samples[4].gbuffer, "jitter": samples[4].view.jitter}
        image, left, _ = task.method.step(*(inputs[name] for name in task.method.inputs()), *state)
    torch.testing.assert_close(stepped.images, image)
    for got, want in zip(stepped.states[0], left, strict=True):
        torch.testing.assert_close(got, want)


def test_gradients_reach_all_weights_and_crops_of_a_batch_do_not_mix() -> None:
    task = FlowTask(random_flow())
    one, two = samples_of(Shadow(3.0), "susu"), samples_of(Shadow(-2.0, edge=40.0), "susu")
    states = [walked(task, frames)[1] for frames in (one, two)]
    both = task.step([one[3], two[3]], states)
    alone = task.step([two[3]], [states[1]])
    torch.testing.assert_close(both.images[1:], alone.images, rtol=0.03, atol=0.03)  # in bfloat16
    loss = both.images.mean() + sum(both.terms.values(), torch.zeros(()))
    assert loss.isfinite()
    loss.backward()  # type: ignore[no-untyped-call]
    assert [n for n, p in task.method.named_parameters() if p.grad is None or not p.grad.any()] == []


def test_it_learns_how_a_shadow_moves() -> None:
    torch.manual_seed(0)
    task = FlowTask(GuidedFlow(SMALL))
    frames = [samples_of(Shadow(speed, edge=24.0), "susu") for speed in (3.0, 2.0)]
    states = [walked(task, samples)[1] for samples in frames]
    optimizer = torch.optim.Adam(task.method.parameters(), lr=1e-2)
    errors = []
    for _ in range(60):
        stepped = task.step([samples[3] for samples in frames], states)
        truth = torch.cat([samples[3].color for samples in frames])
        off = (stepped.images - truth).abs().mean()
        errors.append(float(off.detach()))
        optimizer.zero_grad()
        (off + sum(stepped.terms.values(), torch.zeros(()))).backward()  # type: ignore[no-untyped-call]
        optimizer.step()
    assert errors[0] == pytest.approx(np.mean([guided_error(s) for s in (3.0, 2.0)]), rel=1e-3)
    assert min(errors[-5:]) < 0.6 * errors[0]


def guided_error(speed: float) -> float:
    samples = [samples_of(Shadow(speed, edge=24.0), "susu")[i] for i in (2, 3)]
    inputs = [{**s.gbuffer, "jitter": s.view.jitter} for s in samples]
    method = GuidedWarp()
    image = method.step(*(inputs[1][n] for n in method.inputs()), *method.after_shaded(inputs[0])).image
    return float((image - samples[1].color).abs().mean())


def test_census_counts_what_lies_otherwise_and_not_what_is_brighter_by_the_same() -> None:
    image = 10.0 * torch.rand(1, 2, 9, 9)
    assert census(image, image + 3.0, 7).max() < 1e-6
    assert census(image, image.flip(3), 7).mean() > 0.2
    assert census(image, image.flip(3), 3).shape == (1, 2, 9, 9)


# --- runs ---


def test_validation_hides_every_second_frame(dataset: Dataset) -> None:
    task = FlowTask(random_flow())
    entries = validation_entries([dataset], task.ratios)
    frames, walk = list(dataset.frames(entries[0][1])), task.walk(task.bar.eval(), Size(64, 36))
    drawn = [walk.step(frame) for frame in frames]
    assert [i for i, image in enumerate(drawn) if image is not None] == [1, 3, 5, 7, 9]
    for frame, image in zip(frames, drawn, strict=True):
        assert image is None or image.shape[2:] == walk.truth(frame).shape[:2] == (18, 32)
    found = validate(task.bar.eval(), entries, task.walk)
    assert list(found.scores) == ["psnr"]
    assert found.psnr > 25.0  # all light is even there
    assert validate(GuidedFlow().eval(), entries, task.walk).psnr == pytest.approx(found.psnr)


def test_a_run_writes_weights_and_says_how_it_compares(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gbuffer_sets, "DISPLAY", (160, 90))
    gbuffer_data(tmp_path / "set")
    arguments = ["train", "guided-flow", "--data", tmp_path / "set", "-o", tmp_path / "run", "--size", 36]
    more = ["--batch", 1, "--frames", 2, "--every", 1]
    result = CliRunner().invoke(app, [str(word) for word in [*arguments, *more, "--steps", 2]])
    assert result.exit_code == 0, result.output
    with (tmp_path / "run" / "log.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["step"] for row in rows] == ["1.0", "2.0"]
    assert {"picture", "light", "features", "psnr", "psnr_guided-warp"} <= rows[0].keys()
    assert "tpsnr" not in rows[0]
    trained = load_trained(tmp_path / "run" / "weights.safetensors")
    assert TASKS["guided-flow"](trained).method.learned["steps"] == 2
