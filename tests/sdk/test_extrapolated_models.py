"""A model with a graph of its own for extrapolated frames: which graph runs on which frame."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alternating import Frames
from joint_folder import joint_folder
from lit_scene import LitScene
from shared_models import shared_model
from supersampler import FrameError, Model, ModelError, Upscaler
from supersampler.methods.model_file import extrapolation_names, model_names
from supersampler.recording import open_recording
from supersampler.recording.replay import Replay
from upscale_runs import run as run_command
from upscale_runs import said

SIZE, DISPLAY = (40, 23), (81, 46)
SCENE = LitScene(velocity=(1.3, -0.6), radius=7.0, disc_velocity=(2.5, 0.5), sky=5.0)
shaded = Frames(SCENE, SIZE)
run = shaded.run


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return joint_folder(tmp_path_factory.mktemp("models") / "joint")


@pytest.fixture(scope="module")
def joint(folder: Path) -> Model:
    return Model.load(folder, threads=1, providers="cpu")


@pytest.fixture(scope="module")
def classifier() -> Model:
    return shared_model("classifier", "onnx", providers="cpu")


def make(model: Model, **options: Any) -> Upscaler:
    settings = {"display_size": DISPLAY, "extrapolation": "guided-warp", "validate": "off"}
    return Upscaler(model, **{**settings, **options})


@pytest.mark.parametrize("pattern", ["sususu", "suusuu", "ssuuusus"])
def test_each_kind_of_frame_has_its_graph_and_both_have_one_history(
    joint: Model, classifier: Model, pattern: str
) -> None:
    ours, theirs = make(joint), make(classifier)
    for index, (one, other) in enumerate(zip(run(ours, pattern), run(theirs, pattern), strict=True)):
        if pattern[index] == "s":
            np.testing.assert_array_equal(one, other)
        else:
            base = (shaded(index).gbuffer or {})["base_color"]
            np.testing.assert_allclose(one, other + np.mean(base, dtype=np.float64), atol=1e-5)
    np.testing.assert_equal(ours.save_state().history, theirs.save_state().history)


def test_g_buffers_are_asked_for_only_where_frames_are_extrapolated(joint: Model) -> None:
    plain = make(joint, extrapolation=None)
    assert plain.gbuffers == ()
    assert make(joint).gbuffers == ("gbuffer_base_color", "gbuffer_normal")
    image = plain.step(replace(shaded(0), gbuffer=None))
    np.testing.assert_array_equal(image, make(joint).step(shaded(0)))


def test_maps_and_aovs_go_through_both(joint: Model, classifier: Model) -> None:
    ours, theirs = make(joint), make(classifier)
    for index in range(4):
        aovs = np.full((*SIZE[::-1], 1), 0.1 * index, np.float32)
        frame = shaded(index, aovs=aovs, **({"color": None} if index % 2 else {}))
        steps: list[Any] = [each.extrapolate if index % 2 else each.step for each in (ours, theirs)]
        one, other = (step(frame, outputs=("weight", "aovs")) for step in steps)
        for name in ("weight", "aovs"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        assert one.aovs.shape == (*DISPLAY[::-1], 1)


# --- what is refused ---


def test_a_frame_without_base_colour_is_refused_by_the_graph_that_reads_it(joint: Model) -> None:
    with pytest.raises(FrameError, match=r"gbuffer\['base_color'\] is None.*'joint-drawn' reads it"):
        joint.on_extrapolated.check(shaded(2, gbuffer=None), DISPLAY)


def test_a_model_of_extrapolated_frames_alone_is_refused(folder: Path, joint: Model) -> None:
    path, message = folder / "extrapolated", r"'joint-drawn' only steps on .*joint', extrapolation="
    for use in (Model.load, lambda path: Upscaler.plan(SIZE, DISPLAY, path)):
        with pytest.raises(ModelError, match=message):
            use(path)
    with pytest.raises(ModelError, match=r"'joint-drawn' upscales and does not extrapolate"):
        make(joint, extrapolation=path)
    assert not {"extrapolated", "extrapolate-unshaded"} & {*model_names(), *extrapolation_names()}
    with pytest.raises(ModelError, match="no model 'extrapolate-unshaded'"):
        Model.load("extrapolate-unshaded")


def test_a_folder_whose_inner_one_is_damaged_is_refused(tmp_path: Path) -> None:
    folder = joint_folder(tmp_path / "joint")
    (folder / "extrapolated" / "step.onnx").write_bytes(b"")
    with pytest.raises(ModelError, match=r"extrapolated.step\.onnx: its content is not what"):
        Model.load(folder, providers="cpu")
    (folder / "extrapolated" / "model.json").write_text("{}")
    with pytest.raises(ModelError, match=r"extrapolated.model\.json: its content is not what"):
        Model.load(folder, providers="cpu")


# --- sessions ---


def test_a_plan_is_that_of_shaded_frames(folder: Path, joint: Model) -> None:
    plan = Upscaler.plan(SIZE, DISPLAY, folder, threads=1, providers="cpu")
    assert plan == joint.plan(SIZE, DISPLAY) == joint.on_extrapolated.plan(SIZE, DISPLAY)


def test_a_recording_knows_both_graphs(joint: Model, tmp_path: Path) -> None:
    file = tmp_path / "a.recording"
    with make(joint, record=file) as upscaler:
        run(upscaler, "su")
    assert "extrapolated/model.json" in open_recording(file).setup.files
    other = joint_folder(tmp_path / "other")
    described = (other / "extrapolated" / "model.json").read_text().replace("joint-drawn", "another")
    (other / "extrapolated" / "model.json").write_text(described)
    with pytest.raises(ModelError, match=r"extrapolated.model\.json"):
        Replay(open_recording(file), model=other)


def test_info_names_the_model_for_extrapolated_frames(folder: Path) -> None:
    assert "extrapolated frames by the model in extrapolated" in said(run_command("info", folder))
