"""Tests of the passes that Cycles writes for a denoiser: read as guides, in world space, and not blended."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blender_files import RECORDED
from imported_scene import plane, write_blender
from supersampler import ArgumentError
from supersampler.io.images import read_exr, write_exr
from supersampler.io.shot import Shot, import_blender, open_source
from supersampler.io.shot.blender import Guides, read_render_record

ROTATION = np.array([[0.6, 0.0, -0.8], [0.8, 0.0, 0.6], [0.0, 1.0, 0.0]])  # right, up and back as columns
MIRRORED = np.s_[:6, :6]  # pixels of a mirror: what it shows has another normal


def unit_normals(height: int, width: int) -> np.ndarray:
    normal = np.random.default_rng(1).normal(size=(height, width, 3))
    unit: np.ndarray = (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype(np.float32)
    return unit


def denoising_passes(normal: np.ndarray, layer: str, axes: np.ndarray = ROTATION) -> dict[str, np.ndarray]:
    """What Cycles writes in addition: normals along the camera's right, up and forward."""
    in_camera = (normal @ axes * (1, 1, -1)).astype(np.float32)
    height, width = normal.shape[:2]
    names = {"Denoising Albedo.R": 0.5, "Denoising Albedo.G": 0.25, "Denoising Albedo.B": 1.0}
    others = ["Denoising Depth.Z", *(f"Noisy Image.{axis}" for axis in "RGBA"), "CryptoObject00.r"]
    return {
        **{f"{layer}.{name}": plane(value, (width, height)) for name, value in names.items()},
        **{f"{layer}.{name}": plane(9.0, (width, height)) for name in others},
        **{f"{layer}.Denoising Normal.{axis}": in_camera[..., i] for i, axis in enumerate("XYZ")},
    }


def denoised_frames(
    folder: Path, *, surface: bool = True, bad: float | None = None
) -> tuple[Path, np.ndarray]:
    """Write frames of Cycles with Denoising Data; also return the guides' normals, in world space.

    `bad` is a value of one pixel of the pass Normal.
    """
    write_blender(folder, "V")
    normal = unit_normals(36, 64)
    guide = normal.copy()
    guide[MIRRORED] = (0.0, 0.0, 1.0)
    for path in folder.glob("*.exr"):
        channels = {n: a for n, a in read_exr(path).items() if not n.startswith("V.Normal")}
        if surface:
            channels |= {f"V.Normal.{axis}": normal[..., i].copy() for i, axis in enumerate("XYZ")}
        if bad is not None:
            channels["V.Normal.Y"][20, 30] = bad
        channels["V.GlossDir.R"] = plane(0.5)
        write_exr(path, channels | denoising_passes(guide, "V"))
    return folder, guide


def gbuffer(shot: Shot, index: int = 0) -> Any:
    return shot.read(index).frame.gbuffer


@pytest.mark.parametrize("bad", [None, np.nan, np.inf])
def test_guides_of_the_denoiser_replace_those_of_the_surface(tmp_path: Path, bad: float | None) -> None:
    folder, guide = denoised_frames(tmp_path, bad=bad)
    shot = import_blender(folder, guides="denoising")
    found = gbuffer(shot.cropped(9, 10), 1)
    np.testing.assert_array_equal(found["base_color"][3, 3], (0.5, 0.25, 1.0))
    np.testing.assert_allclose(found["normal"], guide, atol=1e-4)  # in world space, the mirror's pixels, too
    surface = gbuffer(open_source(folder))
    np.testing.assert_array_equal(surface["base_color"][3, 3], (0.0, 0.25, 0.5))


def test_normals_stay_in_camera_space_where_nothing_states_the_camera(tmp_path: Path) -> None:
    folder, guide = denoised_frames(tmp_path, surface=False)
    found = gbuffer(open_source(folder, guides="denoising"))
    np.testing.assert_allclose(found["normal"], guide @ ROTATION * (1, 1, -1), atol=1e-6)


@pytest.mark.parametrize("guides", ["surface", "denoising"])
def test_data_of_the_denoiser_is_not_blended_but_light_passes_are(tmp_path: Path, guides: Guides) -> None:
    shot = import_blender(denoised_frames(tmp_path)[0], guides=guides)
    assert {"A", "GlossDir.R"} <= {*shot.info.aov_names}
    assert not any("Denoising" in name or "Noisy" in name for name in shot.info.aov_names)
    assert {"V.Noisy Image.R", "V.CryptoObject00.r", "V.Denoising Depth.Z"} <= {*shot.ignored_channels}


def test_the_noise_that_cycles_has_removed_comes_back(tmp_path: Path) -> None:
    plain = import_blender(write_blender(tmp_path / "plain", "V"))
    assert plain.with_noise() is plain
    assert not plain.is_denoised
    shot = import_blender(denoised_frames(tmp_path / "denoised")[0])
    noisy = shot.with_noise()
    assert shot.is_denoised
    assert not noisy.is_denoised
    assert (np.asarray(noisy.read(1).frame.color) == 9.0).all()
    assert (np.asarray(shot.read(1).frame.color) != 9.0).any()
    assert noisy.ignored_channels == shot.ignored_channels
    shot.ignored_channels[:] = ["late"]  # as renders set it when their first frame is read
    assert noisy.ignored_channels == ["late"]


@pytest.mark.parametrize(("entry", "samples"), [("4", 4), ("0", None), ("many", None), (None, None)])
def test_frames_of_cycles_state_their_samples(tmp_path: Path, entry: str | None, samples: int | None) -> None:
    path = sorted(write_blender(tmp_path, "V").glob("*.exr"))[0]
    write_exr(path, read_exr(path), metadata={} if entry is None else {"cycles.V.samples": entry})
    assert import_blender(tmp_path).samples == samples


def test_other_guides_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="guides is 'albedo'; want 'surface' or 'denoising'"):
        import_blender(write_blender(tmp_path, "V"), guides="albedo")  # type: ignore[arg-type]


def test_a_render_that_is_to_be_denoised_has_its_guides_in_world_space(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(RECORDED, tmp_path / "render"))
    record = json.loads((folder / "render.json").read_text())
    record["scene"] |= {"denoise": "temporal", "cuts": [7], "display_size": record["scene"]["render_size"]}
    (folder / "render.json").write_text(json.dumps(record))
    for path, camera in zip(sorted(folder.glob("*.exr")), read_render_record(folder).frames, strict=True):
        channels, layer = read_exr(path), "ViewLayer"
        normal = np.stack([channels.pop(f"{layer}.Normal.{axis}") for axis in "XYZ"], axis=-1)
        axes = camera.denoising_axes * (1, 1, -1)
        channels |= denoising_passes(normal, layer, axes)
        write_exr(path, {**channels, f"{layer}.Emit.R": plane(1, (48, 32))})
    shot = open_source(folder)
    items = list(shot)
    assert shot.is_denoised
    assert shot.noisy_channels == tuple(f"ViewLayer.Noisy Image.{axis}" for axis in "RGB")
    record["scene"]["has_strokes"] = True  # the noisy image would lack what was drawn
    (folder / "render.json").write_text(json.dumps(record))
    assert open_source(folder).noisy_channels == ()
    assert [item.frame.reset for item in items] == [True, False, True, False]
    assert not items[2].frame.motion.any()  # another camera's vectors
    assert items[3].frame.motion.any()
    assert items[1].frame.motion_next is items[3].frame.motion_next is None  # the last before a cut, of all
    for now, following in ((0, 1), (2, 3)):
        motion_next, back = items[now].frame.motion_next, open_source(RECORDED).read(following).frame.motion
        assert motion_next is not None
        assert np.median(np.abs(motion_next + back)) < 0.1  # both change slowly over the image
        sky = (items[now].frame.depth == 0) & (items[following].frame.depth == 0)
        assert np.abs(motion_next + back)[sky].max() < 0.1
    assert shot.read_raw(0, gbuffers=()).motion_next is None
    assert items[0].raw.aov_names == ["A", "DiffCol.R", "DiffCol.G", "DiffCol.B", "Emit.R"]
    assert "ViewLayer.CryptoObject00.r" in shot.ignored_channels
    for item, original in zip(items, open_source(RECORDED), strict=True):
        ours, theirs = item.frame.gbuffer or {}, original.frame.gbuffer or {}
        np.testing.assert_allclose(ours["normal"], theirs["normal"], atol=2e-3)
        np.testing.assert_array_equal(ours["base_color"][3, 3], (0.5, 0.25, 1.0))
