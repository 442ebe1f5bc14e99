"""Render a sequence as shots on disk (docs/shots.md), at several ratios that share one reference."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler import ArgumentError, Conventions, RawFrame, halton_jitter
from supersampler.io.shot import ClassMaps, ShotWriter
from supersampler_model.data.labels import thin
from supersampler_model.data.rendered import AOVS, UNIT_BUFFERS, Rendered, labels_of, render_size
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.sequences import Sequence

_MAX_MOTION = 16384.0  # pixels; longer motion points off screen, and half floats end at 65504


@dataclass(frozen=True, kw_only=True)
class ShotForm:
    """Content and encoding of a stored shot."""

    name: str
    ratios: tuple[float, ...]  # display over render size, each >= 1; a shot is written for each
    variants: bool = True  # whether each ratio has its own JSON file and folder; False needs one ratio
    gbuffers: bool = True  # whether G-buffers of render and of display size are stored
    small: bool = False  # whether depth is rounded to 14 bits, and motion to 1 / 256 pixel
    first_reference: int = 0  # the first frame whose reference is stored
    thin: bool = False  # whether the classes include thin objects
    truth: bool = False  # whether references have the planes of `PixelTruth`, and frames its AOVs
    license: str = ""  # licence of the images
    compression: str = "zip"  # see `ShotWriter`
    reference_compression: str = "zip"

    def __post_init__(self) -> None:
        if not self.ratios or min(self.ratios) < 1.0 or (len(self.ratios) > 1 and not self.variants):
            want = "some of at least 1.0; one, without variants"
            raise ArgumentError("ratios", got=self.ratios, want=want)


def variant_name(ratio: float) -> str:
    """Return the name of the variant of a ratio, and of its JSON file: 1.5x, 2x."""
    return f"{ratio:g}x"


def render_frame(sequence: Sequence, renderer: Renderer, index: int, ratio: float) -> Rendered:
    """Render frame `index` of a sequence at a ratio, with display-size surfaces and reference."""
    return next(_at_ratios(sequence, renderer, index, (ratio,)))


def _at_ratios(
    sequence: Sequence, renderer: Renderer, index: int, ratios: tuple[float, ...], *, truth: bool = False
) -> Iterator[Rendered]:
    """Yield frame `index` at each ratio; display-size buffers are shared."""
    scene = sequence.scene(index)
    display, reference = renderer.display(scene), renderer.reference(scene)
    of_reference = renderer.truth(scene) if truth else None
    for ratio in ratios:
        jitter, size = halton_jitter(index, ratio), render_size(renderer.display_size, ratio)
        color, surfaces = renderer.frame(scene, size, jitter=jitter)
        yield Rendered(
            color=color, render=surfaces, display=display, reference=reference, jitter=jitter,
            reset=sequence.cut(index), exposure=scene.camera.exposure, truth=of_reference,
            samples_truth=renderer.samples_truth(scene, size, jitter=jitter) if truth else None,
        )  # fmt: skip


def render_shot(
    folder: Path,
    sequence: Sequence,
    renderer: Renderer,
    form: ShotForm,
    *,
    on_frame: Callable[[], None] = lambda: None,
) -> None:
    """Render the missing frames; a stopped run resumes.

    References have the classes of their pixels (`Shot.read_classes`). `on_frame` is called after each frame
    has been written at all ratios.

    Raises:
        ShotError: writing failed, or the folder holds a shot with other properties.
    """
    writers = [
        ShotWriter(
            folder, name=form.name, display_size=renderer.display_size, frame_rate=sequence.spec.frame_rate,
            license=form.license, resume=True, variant=variant_name(ratio) if form.variants else None,
            compression=form.compression, reference_compression=form.reference_compression,
        )
        for ratio in form.ratios
    ]  # fmt: skip
    first = min(map(len, writers))
    before: Rendered | None = None
    if 0 < first < sequence.spec.frames:
        before = render_frame(sequence, renderer, first - 1, form.ratios[0])
    for index in range(first, sequence.spec.frames):
        classes: ClassMaps | None = None
        has_reference = index >= form.first_reference
        now = before
        frames = _at_ratios(sequence, renderer, index, form.ratios, truth=form.truth)
        for number, (writer, rendered) in enumerate(zip(writers, frames, strict=True)):
            if number == 0:
                now, classes = rendered, _classes(rendered, before, form)
            if len(writer) > index:  # written before a run stopped between two ratios
                continue
            writer.write(
                _stored(rendered, sequence.exposure(index), form),
                reference=rendered.reference.color.astype(np.float16) if has_reference else None,
                classes=classes if has_reference else None,
                truth=rendered.truth.planes() if has_reference and rendered.truth is not None else None,
                shared=number > 0,
            )
        before = now
        on_frame()


def _classes(now: Rendered, before: Rendered | None, form: ShotForm) -> ClassMaps:
    classes = labels_of(now, before)
    return replace(classes, thin=thin(now.label_inputs().pixels).astype(np.uint8)) if form.thin else classes


def _stored(rendered: Rendered, exposure: float | None, form: ShotForm) -> RawFrame:
    """Return a frame in its stored form: motion in half floats, values in [0, 1] in eight bits."""
    frame = rendered.frame()
    depth, motion = frame.depth, np.clip(frame.motion, -_MAX_MOTION, _MAX_MOTION)
    if form.small:
        fraction, exponent = np.frexp(depth)  # 14 significant bits, more than half floats have
        depth = np.asarray(np.ldexp(np.round(np.ldexp(fraction, 14)), exponent - 14), np.float32)
        motion = np.round(motion * 256.0) / 256.0
    buffers = (frame.gbuffer, frame.gbuffer_display) if form.gbuffers else (None, None)
    gbuffer, gbuffer_display = map(_compact, buffers)
    stored = replace(
        frame, depth=depth, motion=motion.astype(np.float16), exposure=exposure, gbuffer=gbuffer,
        gbuffer_display=gbuffer_display,
    )  # fmt: skip
    raw = Conventions().converter().from_frame(stored)
    if rendered.samples_truth is None:
        return raw
    planes = rendered.samples_truth.planes()
    return replace(raw, aovs=np.stack([planes[name] for name in AOVS], axis=-1), aov_names=AOVS)


def _compact(buffers: Any) -> dict[str, NDArray[Any]] | None:
    """Round buffers in [0, 1] to steps of 1 / 255, which compress much better."""
    if buffers is None:
        return None
    rounded = dict(buffers)
    for name in set(rounded) & set(UNIT_BUFFERS):
        steps = np.round(np.clip(rounded[name].astype(np.float32), 0.0, 1.0) * 255.0)
        rounded[name] = (steps / np.float32(255.0)).astype(np.float16)
    return rounded
