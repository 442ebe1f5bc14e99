"""Quality of methods on a shot: one pass, one frame at a time, all methods side by side.

The metrics are in metrics.py, strred.py, masks.py and corners.py. Each frame has scores of the whole image
("full") and without a border ("cropped"). Summaries are over all frames ("all") or those after the warm-up
("warm").
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from supersampler.errors import ArgumentError, ShotError
from supersampler.frame import Float32, Frame, Size
from supersampler.history import StepResult
from supersampler.io.display import auto_exposure, display_transform, missing_pixels, usable_exposure
from supersampler.io.shot import ClassMaps, Shot, ShotFrame
from supersampler.methods.gbuffers import gbuffer_arrays
from supersampler.sequence.both_ways import BothWays, frames_of
from supersampler.upscaler import Upscaler
from supersampler_bench.fsr1 import EASU, EASU_RCAS, Fsr1
from supersampler_bench.fsr2 import FSR2_LIKE, Fsr2Like
from supersampler_bench.quality import masks, metrics, strred
from supersampler_bench.quality.color_video_vdp import Clip
from supersampler_bench.quality.corners import (
    CornerTruth,
    CornerTruths,
    color_trail,
    kinds_of,
    speckle,
    specks,
    thin_kept,
    trail,
)
from supersampler_bench.quality.metrics import Bool
from supersampler_bench.quality.scores import (
    BORDER,
    CLASS_MASKS,
    WARM_UP_FRAMES,
    Counts,
    FrameScores,
    MethodScores,
    Scores,
    count_classes,
)
from supersampler_bench.specs import incompatibility, parse_spec
from supersampler_model.data.rendered import AOVS
from supersampler_model.data.shots import variant_name

NATIVE = ":native"
"""Suffix of methods that step the frames of display size, the variant of the shot at ratio 1."""
OUTSIDE = (EASU, EASU_RCAS, FSR2_LIKE)
"""Baselines by published formulas of others, which are not shipped models."""
Bands = tuple[strred.Plane, strred.Plane]
"""STRRED bands of the previous image and of this one."""


class Stepper(NamedTuple):
    """Computes the images of a shot's frames, in order, from the frames' colour and these G-buffers."""

    name: str
    step: Callable[[ShotFrame], StepResult]
    gbuffers: Collection[str] = ()


def measure_quality(
    shot: Shot, methods: Sequence[str], *, cvvdp: bool = False, on_frame: Callable[[], None] = lambda: None
) -> list[MethodScores]:
    """Step every method through the shot and score the frames that have a reference; see `measure_steppers`.

    `methods` have settings as `parse_spec` reads them (":fp32", ":off", ":x2"), or ":native" for the shot's
    frames of display size, or are among OUTSIDE.
    """
    steppers = [stepper_of(method, shot) for method in methods]
    return measure_steppers(shot, steppers, cvvdp=cvvdp, on_frame=on_frame)


def measure_steppers(
    shot: Shot,
    steppers: Sequence[Stepper],
    *,
    cvvdp: bool = False,
    on_frame: Callable[[], None] = lambda: None,
) -> list[MethodScores]:
    """Return the scores of each stepper, in order; with `cvvdp` also those of ColorVideoVDP."""
    gbuffers = {name for stepper in steppers for name in stepper.gbuffers}
    frames: list[list[FrameScores]] = [[] for _ in steppers]
    truths = _Truths(shot)
    before: list[Float32 | None] = [None] * len(steppers)
    clips = [Clip(shot.frame_rate) for _ in steppers]
    for item in shot.frames(gbuffers=gbuffers):
        truth = truths.next(item)
        for i, stepper in enumerate(steppers):
            stepped = stepper.step(item)
            stepped = replace(stepped, image=stepped.image / np.float32(item.frame.pre_exposure))
            if truth is not None:
                image = display_transform(stepped.image, truth.exposure)
                frames[i].append(_score(image, stepped, before[i], truth))
                if cvvdp and item.index >= WARM_UP_FRAMES:
                    clips[i].add(item.index, *(metrics.crop(one, BORDER) for one in (image, truth.shown)))
            before[i] = stepped.image if truth is not None else None
        on_frame()
    return [MethodScores(s.name, frames[i], jod=clips[i].jod()) for i, s in enumerate(steppers)]


def runnable(shot: Shot, methods: Sequence[str], on_left_out: Callable[[str], None]) -> list[str]:
    """Return the methods that can upscale a shot with references.

    Raises:
        ArgumentError: no method is left.
    """
    display, available = reference_size(shot), gbuffer_arrays(shot.read_raw(0))
    kept = []
    for method in methods:
        reason = ""
        if (alone := method.removesuffix(NATIVE)) not in OUTSIDE:
            size = shot.render_size if method == alone else display
            spec = parse_spec(alone, two_passes=True)
            reason = incompatibility(spec.model, size, display, available)
        if reason:
            on_left_out(f"{shot.name}: {reason}")
        else:
            kept.append(method)
    if not kept:
        raise ArgumentError("--methods", got=", ".join(methods), want=f"one that can upscale {shot.name}")
    return kept


def stepper_of(method: str, shot: Shot) -> Stepper:
    """Return the stepper of a method, given as `measure_quality` takes it, for all frames of a shot.

    Raises:
        ShotError: the method is native, and the shot has no frames of display size.
    """
    if method == FSR2_LIKE:
        fsr2 = Fsr2Like(reference_size(shot), 1.0 / (shot.frame_rate or 60.0))
        return Stepper(method, lambda item: StepResult(fsr2.step(item.frame)))
    if method in (EASU, EASU_RCAS):
        fsr1 = Fsr1(reference_size(shot), sharpens=method == EASU_RCAS)
        return Stepper(method, lambda item: StepResult(*fsr1.step(item.frame)))
    if method.endswith(NATIVE):
        native = _native(shot)
        stepper = stepper_of(method.removesuffix(NATIVE), native)
        frames = native.frames(gbuffers=stepper.gbuffers)

        def step_native(item: ShotFrame) -> StepResult:
            frame = next(frames)
            result = stepper.step(frame)
            factor = np.float32(item.frame.pre_exposure / frame.frame.pre_exposure)
            return replace(result, image=result.image * factor)

        return Stepper(method, step_native)
    upscaler = upscaler_of(method, reference_size(shot), two_passes=True)
    outputs = ["class_map"] * ("class_map" in upscaler.model.info.maps) + ["aovs"] * bool(_aov_indices(shot))
    gbuffers = upscaler.model.info.gbuffers
    if parse_spec(method, two_passes=True).passes == 2:
        runs = BothWays(upscaler, outputs=tuple(outputs))
        images = runs.run(frames_of(shot, runs.buffers))
        return Stepper(method, lambda _: next(images).result, gbuffers)

    def step(item: ShotFrame) -> StepResult:
        result = upscaler.step(item.frame, outputs=outputs)
        return result if isinstance(result, StepResult) else StepResult(result)

    return Stepper(method, step, gbuffers)


def _native(shot: Shot) -> Shot:
    """Return the frames of a shot at display size: its variant at ratio 1."""
    folder = shot.path.parent if shot.path.is_file() else shot.path
    path = folder / f"{variant_name(1.0)}.json"
    if not path.exists():
        hint = "`supersampler bench shots` renders the test shots at display size, too."
        raise ShotError(shot.path, f"has no frames of display size: there is no {path.name}", hint)
    native = Shot.open(path)
    if len(native) != len(shot):
        raise ShotError(path, f"has {len(native)} frames, {shot.path.name} has {len(shot)}", "Finish both.")
    return native


def upscaler_of(
    method: str, display_size: Size, extrapolation: str | None = None, *, two_passes: bool = False
) -> Upscaler:
    """Return an Upscaler with the settings that `parse_spec` reads."""
    spec = parse_spec(method, two_passes=two_passes)
    return Upscaler(
        spec.model,
        display_size=display_size,
        precision=spec.precision,
        at_rest=spec.at_rest,
        executor=spec.executor,
        extrapolation=extrapolation,
        validate="off",
    )


def reference_size(shot: Shot) -> Size:
    """Return the (width, height) of a shot's references.

    Raises:
        ShotError: it has none.
    """
    if not shot.reference_indices or shot.display_size is None:
        hint = "Render some frames with many samples per pixel at display size, and list them in shot.json."
        raise ShotError(shot.path, "no frame has a reference to measure against", hint)
    return shot.display_size


def _aov_indices(shot: Shot) -> dict[str, int]:
    """Return the index of each AOV of a shot that measures of corners read."""
    names = shot.info.aov_names
    return {name: names.index(name) for name in AOVS if name in names}


@dataclass(frozen=True)
class _Truth:
    """The reference of one frame, without pre-exposure, with masks and classes, which all methods share."""

    frame: int
    exposure: float
    shown: Float32  # (H, W, 3), the reference after the display transform
    previous: Float32 | None  # the previous reference at this frame's exposure; None without one
    motion: Float32  # (H, W, 2), display pixels
    masks: dict[str, Bool]  # (H, W) each
    classes: ClassMaps | None
    bands: Bands | None  # None where the frame does not end a pair of STRRED
    corners: CornerTruth | None
    specks: Float32 | None  # (H, W), of the reference; None without corners
    aovs: dict[str, int]  # index of each AOV by its name
    is_first: bool  # whether the image has no history


class _Truths:
    """Computes the truth of each frame, in order; keeps the previous frame and reference."""

    def __init__(self, shot: Shot) -> None:
        self._shot, self._display_size = shot, reference_size(shot)
        self._corners = CornerTruths(self._display_size[0] / shot.render_size[0])
        self._frame: Frame | None = None
        self._reference: Float32 | None = None
        self._paired = False  # whether the last frame ended a pair of STRRED; pairs do not overlap

    def next(self, item: ShotFrame) -> _Truth | None:
        """Return the truth of the next frame; None if it has no reference.

        Raises:
            ShotError: the reference has a NaN.
        """
        reference = None if item.reference is None else item.reference / np.float32(item.frame.pre_exposure)
        if reference is not None and (missing := int(missing_pixels(reference).sum())):
            problem = f"the reference of frame {item.index} has {missing} pixels of NaN"
            raise ShotError(self._shot.path, problem, "Render it again, or remove it from shot.json.")
        truth = None if reference is None else self._truth(item, reference)
        self._paired = truth is not None and truth.bands is not None
        self._frame, self._reference = item.frame, reference
        return truth

    def _truth(self, item: ShotFrame, reference: Float32) -> _Truth:
        frame, classes = item.frame, self._shot.read_classes(item.index)
        exposure = usable_exposure(frame.exposure) or auto_exposure(reference)
        known = {"moving": self._to_display(masks.moving(frame), frame)}
        if classes is None:
            known["disoccluded"] = self._to_display(masks.disoccluded(frame, self._frame), frame)
        else:
            known |= masks.of_classes(classes)
        earlier = None if frame.reset else self._reference
        shown = display_transform(reference, exposure)
        previous = None if earlier is None else display_transform(earlier, exposure)
        motion = masks.display_motion(frame, self._display_size)
        planes = self._shot.read_truth(item.index)
        edges = np.zeros(shown.shape[:2], bool) if classes is None else classes.alias == 1
        is_new = frame.reset or self._reference is None
        corners = self._corners.next(planes, motion, known["disoccluded"] | edges, reset=is_new)
        if corners is not None:
            known["shadow_edges"] = corners.shadow_edges
            known |= {f"kind_{kind}": mask for kind, mask in kinds_of(corners, edges).items()}
        return _Truth(
            frame=item.index,
            exposure=exposure,
            shown=shown,
            previous=previous,
            motion=motion,
            masks=known,
            classes=classes,
            bands=None if previous is None or self._paired else _bands(previous, shown),
            corners=corners,
            specks=None if corners is None else specks(shown, corners.window),
            aovs=_aov_indices(self._shot),
            is_first=frame.reset or self._frame is None,
        )

    def _to_display(self, mask: Bool, frame: Frame) -> Bool:
        return masks.to_display(mask, frame.jitter, self._display_size)


def _bands(previous: Float32, shown: Float32) -> Bands:
    return strred.band(strred.luma255(previous)), strred.band(strred.luma255(shown))


def _score(shown: Float32, stepped: StepResult, before: Float32 | None, truth: _Truth) -> FrameScores:
    flip = metrics.flip_map(shown, truth.shown)
    previous = None if before is None else display_transform(before, truth.exposure)
    bands = None if truth.bands is None or previous is None else _bands(previous, shown)
    of_image = None if truth.corners is None else specks(shown, truth.corners.window)

    def scores(border: int) -> Scores:
        corners = _corners(shown, of_image, stepped.aovs, truth, border)
        return _scores(shown, previous, truth, flip, border) | _strred(bands, truth.bands, border) | corners

    def classes(border: int) -> Counts | None:
        if stepped.class_map is None or truth.classes is None:
            return None
        return count_classes(stepped.class_map, truth.classes, border)

    return FrameScores(truth.frame, scores(0), scores(BORDER), classes(0), classes(BORDER))


def _scores(shown: Float32, previous: Float32 | None, truth: _Truth, flip: Float32, border: int) -> Scores:
    """Score one image without `border` pixels. Metrics with a footprint are computed before the crop."""
    image, reference = metrics.crop(shown, border), metrics.crop(truth.shown, border)
    scores = {
        "psnr": metrics.psnr(image, reference),
        "ssim": metrics.ssim(image, reference),
        "flip": float(metrics.crop(flip, border).mean(dtype=np.float64)),
        "tpsnr": float("nan"),
        "warped_error_difference": float("nan"),
    }
    if truth.is_first:
        scores["psnr_first"] = scores["psnr"]
    for name in dict.fromkeys((*CLASS_MASKS, *truth.masks)):
        mask = metrics.crop(truth.masks.get(name, np.zeros(shown.shape[:2], bool)), border)
        scores[f"psnr_{name}"] = metrics.psnr(image, reference, mask)
        scores[f"pixels_{name}"] = float(mask.sum())
    if previous is not None and truth.previous is not None:
        earlier, earlier_reference = metrics.crop(previous, border), metrics.crop(truth.previous, border)
        scores["tpsnr"] = metrics.tpsnr(image, earlier, reference, earlier_reference)
        valid = np.zeros_like(truth.masks["disoccluded"])
        metrics.crop(valid, border)[...] = ~metrics.crop(truth.masks["disoccluded"], border)
        scores["warped_error_difference"] = metrics.warped_error_difference(
            shown, previous, truth.shown, truth.previous, truth.motion, valid
        )
    return scores


def _corners(
    shown: Float32, of_image: Float32 | None, aovs: Float32 | None, truth: _Truth, border: int
) -> Scores:
    """Score the corners of one image, as far as the shot has planes of truth and the method blends AOVs."""
    corners = truth.corners
    if corners is None or truth.specks is None or of_image is None:
        return {}
    found = {
        "color_trail": color_trail(shown, truth.shown, corners, border),
        "speckle": speckle(of_image, truth.specks, corners, border),
    }
    if aovs is not None and len(truth.aovs) == len(AOVS):
        still, moving = (aovs[..., truth.aovs[name]] for name in AOVS)
        found["trail"] = trail(moving, corners, border)
        found["thin_kept"] = thin_kept(still + moving, corners, border)
    values = {name: measured.value for name, measured in found.items()}
    return values | {f"weight_{name}": measured.weight for name, measured in found.items()}


def _strred(bands: Bands | None, truth: Bands | None, border: int) -> Scores:
    """Score a pair of frames. The border is cropped from the bands, whose pixels are BAND_PIXELS wide."""
    srred = trred = float("nan")
    if bands is not None and truth is not None:
        edge = -(-border // strred.BAND_PIXELS)
        of_pair, of_truth = (
            strred.information(*(metrics.crop(band, edge) for band in pair)) for pair in (bands, truth)
        )
        srred, trred = strred.distance(of_pair, of_truth)
    return {"srred": srred, "trred": trred, "strred": srred * trred}
