"""Tests of `import_arm`: signs, units and order of the imported frames."""

import math
from pathlib import Path

import numpy as np
import pytest

from imported_scene import (
    DISPLAY_SIZE,
    arm_tensors,
    assert_is_the_scene,
    truth,
    write_safetensors,
)
from supersampler import ShotError
from supersampler.io.shot import (
    import_arm,
)


@pytest.mark.parametrize("far", [math.inf, 50.0])
def test_an_arm_sequence_comes_out_as_ours(tmp_path: Path, far: float) -> None:
    shot = import_arm(write_safetensors(tmp_path / "street.safetensors", arm_tensors(far)))
    assert_is_the_scene(shot)
    assert (shot.name, shot.frame_rate, shot.display_size) == ("street", 60.0, DISPLAY_SIZE)
    assert shot.reference_indices == [0, 1, 2]
    assert [item.frame.exposure for item in shot] == pytest.approx([1, 2, 4])
    reference = shot.read(1).reference
    assert reference is not None
    assert reference.dtype == np.float32
    np.testing.assert_allclose(reference, truth(1), atol=1e-3)


def test_an_arm_sequence_without_the_optional_tensors_is_read(tmp_path: Path) -> None:
    tensors = arm_tensors()
    for name in ("ground_truth_linear", "exposure", "seq", "EmulatedFramerate"):
        del tensors[name]
    shot = import_arm(write_safetensors(tmp_path / "a.safetensors", tensors))
    assert_is_the_scene(shot)
    assert (shot.display_size, shot.reference_indices, shot.read(0).frame.exposure) == (None, [], None)


def test_a_change_of_sequence_is_a_cut(tmp_path: Path) -> None:
    tensors = {**arm_tensors(), "seq": np.array([[1], [1], [2]], np.int64)}
    del tensors["camera_cut"]
    assert_is_the_scene(import_arm(write_safetensors(tmp_path / "a.safetensors", tensors)))


def test_pixels_are_left_in_the_file_until_their_frame_is_read(tmp_path: Path) -> None:
    shot = import_arm(write_safetensors(tmp_path / "a.safetensors", arm_tensors()))
    raw = shot.read_raw(1)
    for array in (raw.color, raw.motion):
        assert isinstance(array, np.ndarray)
        base: object = array
        while isinstance(base, np.ndarray):
            assert not isinstance(base, np.memmap)  # a copy of one frame, not a view that keeps the file
            base = base.base


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"jitter": None}, "has no tensor jitter. It has EmulatedFramerate, camera_cut, colour_linear"),
        ({"motion_lr": np.zeros((3, 2, 36, 63), np.float16)}, r"tensor motion_lr is \(3, 2, 36, 63\); want"),
        (
            {"depth_params": np.zeros((3, 3), np.float32)},
            r"tensor depth_params is \(3, 3\); want \(frames, 4\)",
        ),
        ({"colour_linear": np.zeros((3, 36, 64), np.float16)}, r"tensor colour_linear is \(3, 36, 64\)"),
    ],
)
def test_a_tensor_that_is_missing_or_of_another_shape_is_named(
    tmp_path: Path, change: dict[str, np.ndarray | None], message: str
) -> None:
    tensors = {name: value for name, value in {**arm_tensors(), **change}.items() if value is not None}
    with pytest.raises(ShotError, match=message):
        import_arm(write_safetensors(tmp_path / "a.safetensors", tensors))


@pytest.mark.parametrize(
    ("kept", "message"),
    [
        (4, "is not a safetensors file"),
        (100, "ends in its header"),
        (-10, r"tensor that cannot be read \(bytes"),
    ],
)
def test_a_safetensors_file_that_is_cut_off_is_named(tmp_path: Path, kept: int, message: str) -> None:
    path = write_safetensors(tmp_path / "a.safetensors", arm_tensors())
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(ShotError, match=rf"a\.safetensors: .*{message}.*damaged or cut off"):
        import_arm(path)
