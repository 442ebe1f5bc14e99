"""A frame that breaks the contract raises an error with the input, its value and what is wanted."""

from typing import Any

import numpy as np
import pytest

from noise import noise
from shared_models import shared_model
from supersampler import ArgumentError, Frame, FrameError, Shot, Upscaler

H, W = 18, 32


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("depth", np.ones((W, H), np.float32), r"is \(32, 18\) float32; want \(18, 32\) float32. Width and"),
        ("depth", np.ones((H, W, 1), np.float32), r"want \(18, 32\) float32. Drop the last axis"),
        ("depth", np.ones((H, W), np.float16), r"is \(18, 32\) float16; want .* float32. Convert it"),
        ("motion", np.zeros((H, W, 2)), r"is .* float64; want .* float16 or float32"),
        ("motion", np.zeros((2, H, W), np.float32), r"channels first; pass array.transpose\(1, 2, 0\)"),
        ("color", np.zeros((H, W, 4), np.float32), r"want \(18, 32, 3\) .* Keep the first 3 channels"),
        ("color", np.zeros((0, W, 3), np.float32), r"at least one pixel"),
        ("color", np.zeros((H, W, 3), np.uint8), r"uint8; want .* float16 or float32"),
        ("color", np.zeros((1, H, W, 3), np.float32), r"array\[0\]"),
        ("depth", np.zeros((1, H, W), np.float32), r"array\[0\]"),
        ("aovs", np.zeros((5, H, W), np.float32), r"array.transpose\(1, 2, 0\)"),
        ("color", [[1, 2, 3]], r"is list; want a numpy array, or anything with DLPack"),
        ("jitter", (3.0, 0.0), r"is \(3.0, 0.0\); want render pixels in \[-0.5, 0.5\]. Jitter in NDC"),
        ("jitter", (float("nan"), 0.0), r"want render pixels"),
        ("jitter", 0.25, r"is 0.25; want \(x, y\)"),
        ("exposure", 0.0, r"is 0.0; want a finite number > 0, or None"),
        ("exposure", float("inf"), r"is inf"),
        ("aovs", np.zeros((H, W), np.float32), r"want \(18, 32, k\)"),
        ("aovs", np.zeros((H, W, 0), np.float32), r"is \(18, 32, 0\)"),
        ("depth", None, "is None; want a numpy array"),
        ("depth", np.ones((H, W), ">f4"), r"want \(18, 32\) float32.*astype\(np\.float32\)"),
        ("color", np.ma.masked_less(np.ones((H, W, 3), np.float32), 2), r"masked .*array\.filled\(0\)"),
        ("exposure", [1.0], r"is \[1\.0\]; want a finite number"),
        ("exposure", True, "is True"),
        ("exposure", "1", "is '1'"),
        ("reset", "no", "is 'no'; want True or False"),
        ("jitter", ("0", "0"), r"is \('0', '0'\); want \(x, y\), two numbers"),
        ("gbuffer", [1], r"is \[1\]; want a mapping"),
    ],
)
def test_a_bad_input_is_named(name: str, value: object, message: str) -> None:
    with pytest.raises(FrameError, match=rf"frame\.{name} .*?{message}") as caught:
        noise(1, **{name: value})  # type: ignore[arg-type]
    assert caught.value.name == name


@pytest.mark.parametrize(
    ("field", "shapes", "message"),
    [
        ("gbuffer", {"albedo": (H, W, 3)}, "want one of base_color, normal"),
        ("gbuffer", {"normal": (H, W)}, r"want \(18, 32, 3\)"),
        ("gbuffer", {"depth": (H, W)}, "not a G-buffer's name"),
        ("gbuffer_display", {"roughness": (2 * H, 2 * W, 1)}, r"want \(36, 64\)"),
        ("gbuffer_display", {"depth": (36, 64), "normal": (36, 60, 3)}, r"gbuffer_display\['normal'\]"),
    ],
)
def test_a_bad_gbuffer_is_named(field: str, shapes: dict[str, Any], message: str) -> None:
    buffers: Any = {name: np.zeros(shape, np.float32) for name, shape in shapes.items()}
    with pytest.raises(FrameError, match=message):
        noise(1, **{field: buffers})


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (np.zeros((H, W, 3), np.int32), r"is \(18, 32, 3\) int32; want"),
        (np.zeros((H + 1, W, 3), np.float32), r"is \(19, 32, 3\) float32; want"),
        ([0.0], "is list; want a numpy array"),
    ],
)
def test_a_gbuffer_that_was_exchanged_is_checked_again(changed: Any, message: str) -> None:
    frame = noise(1, gbuffer={"normal": np.zeros((H, W, 3), np.float32)})
    buffers: Any = frame.gbuffer
    buffers["normal"] = changed
    with pytest.raises(FrameError, match=rf"gbuffer\['normal'\] {message}"):
        Upscaler(shared_model("taau"), scale=2.0).step(frame)


def test_sizes_are_width_first_and_arrays_height_first() -> None:
    for frame in (noise(1, (32, 18)), noise(1, (32, 18), color=None)):
        assert (frame.size, frame.depth.shape) == ((32, 18), (18, 32))


class Exporter:
    """Speaks DLPack and nothing else, as a foreign tensor does."""

    def __init__(self, array: np.ndarray[Any, Any]) -> None:
        self.array = array

    def __dlpack__(self, **options: Any) -> object:
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self) -> object:
        return self.array.__dlpack_device__()


def test_anything_with_dlpack_is_taken() -> None:
    depth = np.full((H, W), 0.5, np.float32)
    frame = noise(1, depth=Exporter(depth))
    assert isinstance(frame.depth, np.ndarray)
    np.testing.assert_array_equal(frame.depth, depth)


def test_a_frame_cannot_be_changed() -> None:
    with pytest.raises(AttributeError):
        noise(1).reset = True  # type: ignore[misc]


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("all_first", [True, False])
def test_channels_first_arrays_are_refused_with_the_transpose_to_use(channels: int, all_first: bool) -> None:
    depth, motion = np.zeros((H, W), np.float32), np.zeros((H, W, 2), np.float32)
    if all_first:
        depth, motion = depth[None], motion.transpose(2, 0, 1)
    color = np.zeros((channels, H, W), np.float32)
    with pytest.raises(FrameError) as caught:
        Frame(color=color, depth=depth, motion=motion, jitter=(0.0, 0.0))
    message = str(caught.value)
    assert f"is ({channels}, {H}, {W}) float32; want ({H}, {W}, 3)" in message
    turned = eval(message.partition("pass ")[2].rstrip("."), {"array": color})  # noqa: S307  # the advice
    assert turned.shape == (H, W, 3)


def test_a_step_without_a_frame_names_the_argument_and_prints_no_pixels() -> None:
    shot = Shot.open("plaza")
    item = shot.read(0)
    upscaler = Upscaler("bilinear", display_size=(640, 360))
    for value, advice in (
        (item, "Pass the `frame` of the ShotFrame"),
        ([item.frame], "one frame per call"),
        (item.frame.color, "Frame(color=, depth=, motion=, jitter=) takes the arrays"),
        (shot.read_raw(0), "`Conventions.converter` converts a RawFrame"),
        ({"color": item.frame.color}, "want a supersampler.Frame"),
    ):
        with pytest.raises(ArgumentError) as caught:
            upscaler.step(value)  # type: ignore[call-overload]
        message = str(caught.value)
        assert advice in message
        assert len(message) < 200
        assert "array(" not in message
