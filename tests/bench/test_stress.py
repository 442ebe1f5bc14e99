"""Stress scenarios: sound methods pass, broken ones fail, and growing errors are measured."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import upscale_runs
from supersampler import ArgumentError, Frame
from supersampler.frame import Float32, Size
from supersampler.history import State
from supersampler.methods.model_file import shipped_model
from supersampler_bench.cli.options import split_list
from supersampler_bench.record import read_record
from supersampler_bench.stress.compare import VisibleDifference, contraction, recovery
from supersampler_bench.stress.hostile import MIN_BOUND, hostile_bound
from supersampler_bench.stress.runner import ScenarioOutcome, StressRecord, chosen, measure, run, runs
from supersampler_bench.stress.scenario import FAMILIES, ROUNDING, Figure, Scenario, Session, Subject
from supersampler_bench.stress.scenes import LAP, LOOP, PERIOD, Orbit, moving, still
from supersampler_bench.stress.subjects import subjects
from supersampler_model.data.scenes.analytic import EXTENT, places
from upscale_runs import succeeded

DISPLAY: Size = (48, 32)
SHORT = ("single frames", "one frame", "two frames")
"""Scenarios of two passes."""
Mend = Callable[[Float32], Float32]


def sound(color: Float32) -> Float32:
    """Bad values are black."""
    return np.where((color >= 0.0) & (color <= 65504.0), color, np.float32(0.0))


class Average:
    """Blends `keep` of the history with `new` of the frame."""

    def __init__(
        self, display: Size, keep: float | Float32 = 0.9, new: float = 0.1, mend: Mend = sound
    ) -> None:
        self._display, self._keep, self._new, self._mend = display, keep, new, mend
        self._past: Float32 | None = None

    def step(self, frame: Frame) -> Float32:
        (width, height), (w, h) = self._display, frame.size
        rows, columns = np.arange(height) * h // height, np.arange(width) * w // width
        shown = self._mend(np.asarray(frame.color, np.float32)[rows[:, None], columns])
        if self._past is None or frame.reset:
            self._past = shown
        else:
            self._past = (self._keep * self._past + self._new * shown).astype(np.float32)
        return self._past.copy()

    def save_state(self) -> State:
        assert self._past is not None
        return State("average", self._display, None, {"history.color": self._past.copy()})

    def load_state(self, state: State) -> None:
        assert state.history is not None
        self._past = np.array(state.history["history.color"])


def subject(begin: Callable[[Size, int], Session]) -> Subject:
    return Subject("average", "cpu", "fp32", remembers=True, reach=8.0, begin=begin)


SOUND = subject(lambda display, _: Average(display))
KEEPS_BAD = subject(lambda display, _: Average(display, mend=lambda color: color))
DIVERGES = subject(lambda display, _: Average(display, keep=1.01))


def scenario(name: str) -> Scenario:
    (found,) = chosen([name])
    return found


def failed(outcome: ScenarioOutcome) -> list[str]:
    return [figure.name for figure in outcome.figures if not figure.passed]


@pytest.mark.parametrize("keep", [0.8, 0.97, 1.02])
def test_contraction_of_a_known_recursion_is_its_weight(keep: float) -> None:
    found = contraction(
        Average(DISPLAY, keep=keep), Average(DISPLAY, keep=keep), still((24, 16)), 6, 1e-3, warm_up=4
    )
    assert found.rate == pytest.approx(keep, abs=2e-4)
    assert found.rates[2:] == pytest.approx([keep] * 4, abs=2e-4)


def test_contraction_finds_the_slowest_of_all_errors() -> None:
    keep = np.full((*DISPLAY[::-1], 1), 0.5, np.float32)
    keep[5, 7] = 0.95
    base, other = Average(DISPLAY, keep=keep), Average(DISPLAY, keep=keep)
    found = contraction(base, other, still((24, 16)), 12, 1e-3, warm_up=4)
    assert found.rate == pytest.approx(0.95, abs=2e-3)


def test_contraction_stops_when_the_difference_is_gone() -> None:
    base, other = Average(DISPLAY, keep=0.0, new=1.0), Average(DISPLAY, keep=0.0, new=1.0)
    found = contraction(base, other, still((24, 16)), 12, 1e-3, warm_up=4)
    assert found.rates == [0.0]
    assert found.rate < 1e-6


class WithSum(Average):
    """An average that also carries the sum of its changes, in which no difference fades."""

    total: Float32 = np.zeros((*DISPLAY[::-1], 3), np.float32)

    def step(self, frame: Frame) -> Float32:
        before = self._past
        image = super().step(frame)
        self.total = self.total + (0.0 if before is None else 50.0 * (image - before))
        assert np.abs(self.total).max() <= 110.0
        return image

    def save_state(self) -> State:
        state = super().save_state()
        return replace(state, history={**(state.history or {}), "history.total": self.total})

    def load_state(self, state: State) -> None:
        super().load_state(state)
        assert state.history is not None
        self.total = np.array(state.history["history.total"])


def test_contraction_keeps_a_persistent_tensor_within_its_values() -> None:
    base, other = WithSum(DISPLAY, keep=0.5), WithSum(DISPLAY, keep=0.5)
    found = contraction(base, other, still((24, 16)), 6, 1e-3, warm_up=4)
    assert found.rate == pytest.approx(0.5, abs=2e-3)


@pytest.mark.parametrize(
    "name", ["at rest", "values not a number", "extreme depth", "contraction at rest", "threads"]
)
def test_a_sound_average_passes(name: str) -> None:
    outcome = run(scenario(name), SOUND, quick=True)
    assert outcome.error == ""
    assert failed(outcome) == []


def test_a_method_that_keeps_a_bad_value_fails() -> None:
    outcome = run(scenario("values not a number"), KEEPS_BAD, quick=True)
    assert not outcome.passed
    assert failed(outcome) == ["frames until clean", "bad values"]


def test_single_frames_flicker() -> None:
    spatial = subject(lambda display, _: Average(display, keep=0.0, new=1.0))
    [flicker] = [f for f in run(scenario("at rest"), spatial, quick=True).figures if "flicker" in f.name]
    assert flicker.value > 1.0 > flicker.bound > 0.3


@pytest.mark.parametrize("name", ["spike of 65504", "fireflies"])
def test_light_that_remains_longer_than_one_and_a_half_periods_fails(name: str) -> None:
    clipped = subject(lambda display, _: Average(display, mend=lambda color: np.minimum(sound(color), 2.0)))
    assert failed(run(scenario(name), SOUND)) == ["frames until clean"]
    assert failed(run(scenario(name), clipped)) == []


def test_a_diverging_method_fails() -> None:
    outcome = run(scenario("contraction at rest"), DIVERGES, quick=True)
    assert failed(outcome) == ["rate a frame", "rate, worst 16 frames"]
    assert outcome.figures[0].value == pytest.approx(1.01, abs=1e-3)
    assert {"mean abs difference", "PSNR lost, dB"} <= set(
        failed(run(scenario("at rest"), DIVERGES, quick=True))
    )


def test_an_exception_fails_only_its_scenario() -> None:
    def begin(display: Size, threads: int) -> Session:
        raise RuntimeError("no device")

    outcomes = list(measure([scenario("threads")], [subject(begin), SOUND], quick=True))
    assert [o.passed for o in outcomes] == [False, True]
    assert outcomes[0].error == "RuntimeError: no device"
    table = StressRecord(outcomes, quick=True).table()
    assert "- threads, average cpu: broke. RuntimeError: no device" in table


def test_a_shipped_method_passes_scenarios_that_need_equal_bits() -> None:
    for outcome in measure(
        chosen(["sessions", "a cut in every frame"]), subjects(["taau"], ["cpu"]), quick=True
    ):
        assert outcome.passed, outcome


def two_passes(spoiled: Callable[[Sequence[Frame], int], bool]) -> Subject:
    """Two passes have the images of one, but for those that are spoiled: half as bright."""

    def upscaled(frames: Sequence[Frame], display: Size, passes: int) -> Iterator[Float32]:
        average = Average(display)
        for index, frame in enumerate(frames):
            image = average.step(frame)
            yield 0.5 * image if passes == 2 and spoiled(frames, index) else image

    return replace(SOUND, method="average:x2", sequences=upscaled)


def is_single(frames: Sequence[Frame], index: int) -> bool:
    return frames[index].reset and (index + 1 == len(frames) or frames[index + 1].reset)


@pytest.mark.parametrize(
    ("spoiled", "losers"),
    [
        pytest.param(lambda *_: False, [], id="nothing"),
        pytest.param(is_single, ["single frames", "one frame"], id="single frames"),
        pytest.param(lambda _, index: index == 1, [*SHORT], id="one frame of all"),
    ],
)
def test_a_shot_that_two_passes_make_worse_fails(
    spoiled: Callable[[Sequence[Frame], int], bool], losers: list[str]
) -> None:
    outcomes = {name: run(scenario(f"two passes: {name}"), two_passes(spoiled), quick=True) for name in SHORT}
    assert all(outcome.error == "" for outcome in outcomes.values())
    worst = [name for name in SHORT if "PSNR lost, worst shot, dB" in failed(outcomes[name])]
    assert worst == losers


def test_bad_values_of_two_passes_count() -> None:
    nan = np.full((32, 48, 3), np.nan, np.float32)
    bad = replace(SOUND, sequences=lambda frames, *_: [nan] * len(frames))
    assert "bad values" in failed(run(scenario("two passes: one frame"), bad, quick=True))


def test_a_method_of_two_passes_runs_only_the_scenarios_of_two_passes() -> None:
    one, two = subjects(["taau", "taau:x2"], ["cpu"])
    names = {found.name for found, subject in runs(chosen([]), [one, two]) if subject is two}
    assert names == {found.name for found in FAMILIES["two-passes"]}
    assert names >= {f"two passes: {case}" for case in ("cuts", "still", "huge", "exposure", *SHORT)}
    assert not names & {found.name for found, _ in runs(chosen([]), [one])}


def test_each_scenario_can_be_named_in_a_list() -> None:
    for name in (each.name for family in FAMILIES.values() for each in family):
        assert [found.name for found in chosen(split_list(name))] == [name]


def test_two_passes_of_a_shipped_method_lose_nothing_in_short_shots() -> None:
    for outcome in measure(chosen(["two-passes"], quick=True), subjects(["taau:x2"], ["cpu"]), quick=True):
        assert outcome.passed, outcome
        assert outcome.figures[0].value < (0.05 if outcome.scenario == "two passes: one frame" else -0.2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            "--methods gbuffer-small --executors cpu",
            "--methods is 'gbuffer-small'; want methods that run on cpu",
        ),
        ("--methods taa+no-such", "no model 'no-such'"),
        ("--methods taa --quick --only fireflies", "--only is 'fireflies'; want scenarios that suit one of"),
        (
            "--methods bilinear --only light",
            "--only is 'light'; want scenarios that suit one of the methods.",
        ),
    ],
)
def test_a_command_that_would_run_nothing_is_refused(options: str, message: str) -> None:
    assert message in upscale_runs.refusal("bench", "stress", *options.split())


def test_a_subject_has_the_settings_that_its_method_names() -> None:
    frames = [*still((24, 16))] * 3
    images = {}
    for method in ("taau", "taau:off"):
        [subject] = subjects([method], ["cpu"])
        session = subject.begin(DISPLAY, 1)
        images[method] = [session.step(frame) for frame in frames][-1]
    assert np.abs(images["taau"] - images["taau:off"]).max() > 0.0


def test_with_an_extrapolation_model_every_second_frame_is_unshaded() -> None:
    [subject] = subjects(["taa+guided-warp"], ["cpu"])
    assert (subject.method, subject.executor) == ("taa+guided-warp", "cpu")
    frames = [replace(frame, reset=i == 4) for i, frame in enumerate(moving((24, 16))[:6])]
    shaded, alternating = (subjects([m], ["cpu"])[0] for m in ("taa", "taa+guided-warp"))
    one, other = (s.begin(DISPLAY, 1) for s in (shaded, alternating))
    apart = [np.abs(one.step(frame) - other.step(frame)).max() > 0.0 for frame in frames]
    # an unshaded frame stays in the history until the cut
    assert apart == [index not in (0, 4) for index in range(6)]


def test_shaded_frames_have_all_jitter_phases_if_every_second_frame_is_unshaded() -> None:
    [subject] = subjects(["taa+guided-warp"], ["cpu"])
    for frames in (still((24, 16), subject.every), moving((24, 16), subject.every)):
        shaded, unshaded = ([frame.jitter for frame in frames[first::2]] for first in (0, 1))
        assert len(set(shaded)) == PERIOD
        assert unshaded == shaded
        assert len(shaded) % PERIOD == 0  # a loop ends with a period of the jitter


def test_a_folder_of_a_model_may_recover_as_slowly_as_the_model_that_ships() -> None:
    by_name, by_folder = subjects(["taau", str(shipped_model("taau"))], ["cpu"])
    assert by_folder.recovery == by_name.recovery


def test_recovery_ends_with_the_last_visible_difference() -> None:
    clean, mean, spot = (
        VisibleDifference(0.0, 0.0),
        VisibleDifference(0.01, 0.01),
        VisibleDifference(0.0, 0.2),
    )
    assert recovery([mean, clean, spot, clean, clean]) == 3
    assert recovery([clean, clean]) == 0
    assert recovery([clean, mean]) == 2


def test_the_bound_is_the_largest_error_after_a_reset_and_measuring_stops_early() -> None:
    measured = []

    def after_resets() -> Iterator[VisibleDifference]:
        for p999 in (0.02, 0.05, 0.03, 0.09):
            measured.append(p999)
            yield VisibleDifference(0.0, p999)

    bound = hostile_bound(VisibleDifference(0.0, 0.04), after_resets())
    assert bound == VisibleDifference(MIN_BOUND.mean, 0.05 + ROUNDING)
    assert measured == [0.02, 0.05]
    assert hostile_bound(VisibleDifference(0.0, 0.5), after_resets()).p999 == 0.09 + ROUNDING
    assert hostile_bound(VisibleDifference(0.0, 0.0), after_resets()).p999 == 0.02 + ROUNDING


def test_nan_is_outside_of_every_bound() -> None:
    assert not Figure("difference", float("nan"), 1.0).passed
    assert Figure("difference", 1.0, 1.0).passed


def test_the_moving_scene_repeats_and_its_motion_is_exact() -> None:
    frames = moving((64, 36))
    assert len(frames) == LOOP
    again = Orbit().frame(LOOP, (64, 36), frames[0].jitter)
    np.testing.assert_allclose(np.asarray(frames[0].color), np.asarray(again.color), atol=1e-6)
    x, y = places((64, 36))
    now = Orbit().surface(LAP // 3, x, y)
    there = Orbit().surface(LAP // 3 - 1, x + now.motion[..., 0], y + now.motion[..., 1])
    seen = (there.depth == now.depth) & (x < EXTENT[0])  # not what the disc hides
    np.testing.assert_allclose(there.color[seen], now.color[seen], atol=1e-9)
    assert seen.mean() > 0.9


def test_every_scenario_has_a_description() -> None:
    scenarios: Sequence[Scenario] = [s for family in FAMILIES.values() for s in family]
    assert len({s.name for s in scenarios}) == len(scenarios) >= 25
    assert all(s.description.endswith(".") for s in scenarios)
    assert {s.name for s in chosen(["light"])} == {s.name for s in FAMILIES["light"]}
    with pytest.raises(ArgumentError, match="only is 'weather'"):
        chosen(["weather"])


def test_values_outside_their_bound_are_marked() -> None:
    good = run(scenario("threads"), SOUND, quick=True)
    bad = replace(
        good, method="other", figures=(Figure("difference", 0.5, 0.0), Figure("bad values", 3.0, 0.0))
    )
    table = StressRecord([good, bad], quick=True).table()
    assert "| threads | difference | 0 | 0 | **0.5** |" in table
    assert "| values not in [0, 65504] | 0 | 0 | **3** |" in table
    assert "2 of 4 figures are within their bounds" in table
    assert StressRecord([good, bad], quick=True).exceeded_table() == table
    assert StressRecord([good], quick=True).exceeded_table() == "All 2 figures are within their bounds."


def test_the_command_writes_a_record_and_a_table(tmp_path: Path) -> None:
    arguments = ["stress", "--quick", "--only", "threads", "--methods", "taa,bilinear"]
    result = succeeded(upscale_runs.run("bench", *arguments, "--json", tmp_path / "stress.json"))
    assert (
        "| scenario | figure | at most | taa cpu | taa onnx | bilinear cpu | bilinear onnx |" in result.output
    )
    record = StressRecord.from_json(read_record(tmp_path / "stress.json"))
    assert "| threads | Images with 2, 3 and 5 threads equal those with one," in record.table_text(
        "scenarios"
    )
    assert "| threads | difference |" in result.output
    assert "Images with 2, 3 and 5 threads" not in result.output, "what is done is for the page"
    assert '"outcomes"' in (tmp_path / "stress.json").read_text()
