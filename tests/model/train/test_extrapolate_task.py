"""Training of `extrapolate` on alternating shaded and unshaded frames."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import torch

from gbuffer_sets import DISPLAY
from supersampler.errors import ArgumentError
from supersampler.methods.classifier.spec import ClassifierConfig, NetworkConfig
from supersampler_model import ops
from supersampler_model.data.dataset.storage import Dataset, TrainingFrame
from supersampler_model.data.labels import Ghost
from supersampler_model.methods.base import Trained, load_trained, shipped_weights
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.extrapolate import Extrapolate
from supersampler_model.training.classifier_tasks import ExtrapolateTask
from supersampler_model.training.crops import CropFrame, CropRegion, StreamPosition
from supersampler_model.training.datasets import unshaded_set
from supersampler_model.training.task import State, Stepped, start_task
from supersampler_model.training.validation import SequenceRunner, validate, validation_entries
from upscale_runs import run

pytest_plugins = ["training_fixtures"]

SMALL = ClassifierConfig(network=NetworkConfig(levels=(8, 16, 32, 64), decoder=8, hidden=8))
SIZE = 32


@pytest.fixture
def task() -> ExtrapolateTask:
    torch.manual_seed(0)
    return ExtrapolateTask(Extrapolate(SMALL).eval())


def frames(dataset: Dataset) -> list[TrainingFrame]:
    return list(dataset.frames(dataset.entries("train")[0]))


def samples(data: Dataset, unshaded: int) -> list[CropFrame]:
    """Return a crop with so many unshaded frames after each shaded one."""
    cut = CropRegion(left=9, top=3, size=SIZE, gbuffers="render")
    every = [cut.cut(f, reset=i == 0) for i, f in enumerate(frames(unshaded_set(data, (1.0, 3.0))))]
    return [sample._replace(unshaded=i % (unshaded + 1) > 0) for i, sample in enumerate(every)]


def stepped(task: ExtrapolateTask, sequence: Sequence[CropFrame]) -> list[Stepped]:
    made, states = list[Stepped](), list[State]([task.first_state(sequence[0])])
    for sample in sequence:
        made.append(task.step([sample], states))
        states = made[-1].states
    return made


def test_the_color_of_unshaded_frames_is_not_read(data: Dataset, task: ExtrapolateTask) -> None:
    one, other = samples(data, 1)[:4], samples(data, 1)[:4]
    for index in (1, 3):
        other[index] = other[index]._replace(color=torch.full_like(other[index].color, 7.0))
    task.losses = replace(task.losses, features=0.0)
    for a, b in zip(stepped(task, one), stepped(task, other), strict=True):
        assert torch.equal(a.images, b.images)


def test_the_middle_of_a_crop_is_rendered_as_the_whole_frame_is(data: Dataset) -> None:
    method = Extrapolate(SMALL).eval()
    task, dataset = ExtrapolateTask(method), unshaded_set(data, (1.0, 3.0))
    runner, unshaded = task.runner(method, ops.Size(*DISPLAY)), list[bool]()
    sequence = frames(dataset)[:4]
    for frame in sequence:
        image = runner.step(frame)
        unshaded.append(runner.unshaded)
    assert unshaded == [False, True, False, True]
    cut = CropRegion(0, 0, 36, gbuffers="render")
    crop = [
        cut.cut(f, reset=i == 0)._replace(unshaded=is_unshaded)
        for i, (f, is_unshaded) in enumerate(zip(sequence, unshaded, strict=True))
    ]
    with torch.no_grad():
        made = stepped(task, crop)
    assert image is not None
    off = (made[-1].images - image[:, :, :, :36]).abs()[:, :, 4:-4, 12:-12]
    assert torch.quantile(off, 0.9) < 0.02


def test_errors_weigh_more_where_the_history_of_an_extrapolated_frame_was_occluded(
    data: Dataset, task: ExtrapolateTask
) -> None:
    revealed = [s._replace(ghost=torch.full_like(s.ghost, Ghost.VISIBILITY)) for s in samples(data, 1)[:2]]
    shaded, unshaded = (done.weight for done in stepped(task, revealed))
    assert isinstance(shaded, torch.Tensor)
    assert isinstance(unshaded, torch.Tensor)
    assert (shaded == 1.5).all()
    assert (unshaded == 2.0).all()


def test_features_of_both_encoders_are_compared_on_shaded_frames_that_could_be_extrapolated(
    data: Dataset, task: ExtrapolateTask
) -> None:
    crop = samples(data, 1)[:3]
    made = [done.terms["features"].item() for done in stepped(task, crop)]
    assert made[:2] == [0.0, 0.0]  # no history; unshaded
    task.method.net.copy_shaded_encoder()
    alike = stepped(task, crop)[2].terms["features"].item()
    assert 0.0 < alike < made[2]  # the colours differ


def test_crops_have_none_one_or_two_unshaded_frames_after_each_shaded_one(
    data: Dataset, task: ExtrapolateTask
) -> None:
    crops, first = list[str](), task.stream([task.data(data)], size=SIZE, seed=[3])
    for sample in islice(first, 300):
        crops += [""] if sample.reset else []
        crops[-1] += "u" if sample.unshaded else "s" if sample.gbuffer else "-"
    from_classifier = {crop[:5] for crop in crops[:-1]}
    assert from_classifier == {"susus", "suusu", "-----"}
    again = task.stream([task.data(data)], size=SIZE, seed=[3])
    again.position = StreamPosition(1, 2)  # as a run that was stopped there goes on
    assert [sample.unshaded for sample in islice(again, 3)] == [kind == "u" for kind in crops[1][2:5]]


def test_a_set_without_g_buffers_of_render_size_is_refused(data: Dataset) -> None:
    with pytest.raises(ArgumentError, match=r"without G-buffers of render size.*--also 2"):
        unshaded_set(data, (2.5, 3.0))
    assert [e.ratio for e in unshaded_set(data, (1.0, 3.0)).entries("train")] == [2.0]


def test_validation_scores_shaded_and_unshaded_frames_apart(data: Dataset, task: ExtrapolateTask) -> None:
    entries = validation_entries([task.data(data)], task.method.ratios)
    alternating = validate(task.method, entries, task.runner)
    assert alternating.kinds.keys() == {"psnr_shaded", "psnr_unshaded"}
    assert np.mean(list(alternating.kinds.values())) == pytest.approx(alternating.psnr)
    assert validate(task.method, entries).kinds == {}
    plain = validate(Classifier(SMALL).eval(), entries, SequenceRunner)
    assert plain.kinds == {}


def test_a_run_starts_from_a_classifier_or_continues_its_own_weights() -> None:
    weights = load_trained(shipped_weights("classifier-small"))
    from_classifier = start_task("extrapolate", weights).method
    assert from_classifier.provenance == weights.facts
    own = Trained("extrapolate", asdict(SMALL), {"steps": 3}, Extrapolate(SMALL).state_dict())
    assert start_task("extrapolate", own).method.provenance == {"steps": 3}
    assert start_task("extrapolate").method.provenance == {}


def test_the_command_starts_from_classifier_weights_and_reports_both_kinds(
    data: Dataset, tmp_path: Path
) -> None:
    from_classifier = str(shipped_weights("classifier"))
    made = ["--steps", "1", "--size", "24", "--batch", "1", "--frames", "1", "--init", from_classifier]
    done = run("train", "extrapolate", "--data", data.folder, "-o", tmp_path, *made)
    assert done.exit_code == 0, done.output
    facts = load_trained(tmp_path / "weights.safetensors").facts
    assert facts["init"]["data"] == load_trained(shipped_weights("classifier")).facts["data"]
    assert facts["validation"].keys() >= {"psnr_shaded", "psnr_unshaded"}
