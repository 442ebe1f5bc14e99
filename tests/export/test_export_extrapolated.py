"""The two graphs of `extrapolate` share a history in an Upscaler and compute the same images as torch."""

from pathlib import Path

import numpy as np
import pytest
import torch

from lit_scene import LitScene
from shared_models import shared_model
from supersampler import Frame, Upscaler, halton_jitter
from supersampler.frame import Float32
from supersampler_export import folder as folder_module
from supersampler_export.folder import write_model_folder
from supersampler_export.graph import ExportError
from supersampler_model import ops
from supersampler_model.methods.base import Method, load_trained, shipped_weights
from supersampler_model.methods.extrapolate import Extrapolate, UnshadedExtrapolate
from supersampler_model.methods.guided_warp import GuidedWarp
from torch_inputs import step_by_name, tensors_of

SIZE, DISPLAY = (21, 13), (41, 27)
SCENE = LitScene(velocity=(1.3, -0.6), radius=7.0, disc_velocity=(2.5, 0.5), sky=5.0)


@pytest.fixture(scope="module")
def shipped() -> Extrapolate:
    return Extrapolate.of(load_trained(shipped_weights("extrapolate"))).eval()


def frame(index: int, kind: str) -> Frame:
    fields = {"color": None} if kind == "u" else {}
    return SCENE.frame(index, SIZE, halton_jitter(index, 2.0), **fields)


def by_torch(method: Extrapolate, pattern: str) -> list[Float32]:
    history, images = method.first_history(ops.Size(*DISPLAY), ops.Size(*SIZE)), []
    warp_history = list[torch.Tensor]()
    for index, kind in enumerate(pattern):
        names = [*UnshadedExtrapolate.inputs(), "gbuffer_normal"]
        given = tensors_of(frame(index, "s"), DISPLAY, names)
        stepping: Method = method
        if kind == "u":
            stepping = method.on_extrapolated()
            given["color"], warp_history, _ = step_by_name(GuidedWarp(), given, warp_history)
        else:
            warp_history = GuidedWarp.after_shaded(given)
        image, history, _ = step_by_name(stepping, given, history)
        images.append(image[0].permute(1, 2, 0).numpy())
    return images


@pytest.mark.parametrize("pattern", ["sususu", "suusuu", "ssuususu"])
def test_upscalers_compute_what_torch_computes_however_frames_alternate(
    shipped: Extrapolate, pattern: str
) -> None:
    model = shared_model("extrapolate", providers="cpu")
    upscaler = Upscaler(model, display_size=DISPLAY, extrapolation="guided-warp", validate="off")
    for index, truth in enumerate(by_torch(shipped, pattern)):
        step = upscaler.step if pattern[index] == "s" else upscaler.extrapolate
        off = np.abs(step(frame(index, pattern[index])) - truth)
        assert np.quantile(off, 0.99) < 1e-3
        assert off.mean() < 1e-4


@pytest.mark.parametrize("inner", [True, False])
def test_nothing_is_written_where_either_is_off(
    shipped: Extrapolate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, inner: bool
) -> None:
    def made(one: Method, _: object) -> dict[str, bytes]:
        if one.spec.only_extrapolated is inner:
            raise ExportError("off")
        return {"model.json": b""}

    monkeypatch.setattr(folder_module, "_folder_files", made)
    with pytest.raises(ExportError):
        write_model_folder(shipped, tmp_path / "mine")
    assert not (tmp_path / "mine").exists()


def test_each_graph_is_written_to_its_own_folder(
    shipped: Extrapolate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folder_module, "_folder_files", lambda one, _: {"model.json": one.name.encode()})
    write_model_folder(shipped, tmp_path / "mine")
    written = {str(p.relative_to(tmp_path)): p.read_text() for p in tmp_path.rglob("*") if p.is_file()}
    assert written == {
        "mine/model.json": "extrapolate",
        "mine/extrapolated/model.json": "extrapolate-unshaded",
    }
