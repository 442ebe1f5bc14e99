"""`taa` averages as Salvi's slides say: a tenth new, the history cut by the box of this frame's colours."""

import pytest
import torch
from torch import Tensor

from supersampler.methods.taa.spec import TaaConfig
from supersampler_model import ops
from supersampler_model.methods.taa import Gathered, Taa
from torch_inputs import plain_inputs

SIZE = ops.Size(6, 4)


def plane(value: float, channels: int = 3) -> Tensor:
    return torch.full((1, channels, SIZE.height, SIZE.width), value)


def gathered(box: ops.Corners, has_history: float = 1.0) -> Gathered:
    """A sample of 0.2 and a history of 0.6, toned RGB."""
    return Gathered(plane(0.2), plane(0.6), plane(has_history, 1), plane(1.0, 1), plane(0.0, 1), box)


def test_a_frame_is_a_tenth_of_the_image_and_the_history_the_rest() -> None:
    method = Taa()
    seen = gathered(ops.Corners(plane(0.0), plane(1.0)))
    weight = method.network(seen, torch.ones(1))
    torch.testing.assert_close(weight, plane(0.1, 1))
    image = Taa(TaaConfig(space="rgb")).finish(seen, weight, torch.ones(1))
    torch.testing.assert_close(ops.tone(image), plane(0.1 * 0.2 + 0.9 * 0.6))


@pytest.mark.parametrize(("has_history", "exposure"), [(0.0, 1.0), (1.0, 0.0)])
def test_without_a_history_the_frame_is_all_of_the_image(has_history: float, exposure: float) -> None:
    weight = Taa().network(
        gathered(ops.Corners(plane(0.0), plane(1.0)), has_history), torch.tensor([exposure])
    )
    assert (weight == 1.0).all()


@pytest.mark.parametrize(("clip", "cut_to"), [("sample", 0.4), ("center", 0.4), ("clamp", 0.4)])
def test_the_history_is_cut_by_the_box_before_it_is_averaged(clip: str, cut_to: float) -> None:
    method = Taa(TaaConfig(space="rgb", clip=clip))  # type: ignore[arg-type]
    image = method.finish(gathered(ops.Corners(plane(0.1), plane(0.4))), plane(0.1, 1), torch.ones(1))
    torch.testing.assert_close(ops.tone(image), plane(0.02 + 0.9 * cut_to), rtol=1e-4, atol=1e-4)


def test_the_box_is_one_deviation_around_the_mean_and_within_the_extent() -> None:
    color = plane(0.0)
    color[..., 2, 2] = 0.9  # mean 0.1, deviation sqrt(0.09 - 0.01) of the nine around
    deviation = 0.08**0.5
    box = Taa(TaaConfig(space="rgb")).neighbourhood_box(color)
    assert float(box[0][0, 0, 2, 2]) == 0.0, "the extent is the narrower bound below"
    assert float(box[1][0, 0, 2, 2]) == pytest.approx(0.1 + deviation, rel=1e-4)
    wide = Taa(TaaConfig(space="rgb", intersect_extent=False, gamma=2.0)).neighbourhood_box(color)
    assert float(wide[0][0, 0, 2, 2]) == pytest.approx(0.1 - 2.0 * deviation, rel=1e-4)
    extent = Taa(TaaConfig(space="rgb", gamma=None)).neighbourhood_box(color)
    assert [float(corner[0, 0, 2, 2]) for corner in extent] == pytest.approx([0.0, 0.9])


def test_colours_are_compared_in_ycocg_after_exposure_and_tone_curve() -> None:
    color = torch.rand(1, 3, 4, 6) * 3.0
    torch.testing.assert_close(Taa().to_space(color), ops.ycocg(ops.tone(color)))
    torch.testing.assert_close(Taa().from_space(Taa().to_space(color)), ops.tone(color))


def test_the_weight_that_is_told_is_that_of_the_history() -> None:
    method = Taa()
    planes = {
        "color": plane(0.3),
        "motion": plane(0.0, 2),
        "jitter": torch.zeros(1, 2),
        "exposure": torch.ones(1),
    }
    planes |= {"display_size": torch.tensor(SIZE), **plain_inputs(SIZE)}
    inputs = [planes[name] for name in method.inputs()]
    first = method.step(*inputs, *method.first_history(SIZE, SIZE))
    assert not first.aux_outputs[0].any()
    torch.testing.assert_close(method.step(*inputs, *first.history).aux_outputs[0], plane(0.9, 1))
