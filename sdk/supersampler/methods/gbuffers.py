"""G-buffers by tensor name: gbuffer_display_normal is `frame.gbuffer_display["normal"]`."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from supersampler.conventions import RawFrame
from supersampler.errors import FrameError, did_you_mean, shown
from supersampler.frame import GBUFFER_CHANNELS, GBUFFER_DISPLAY_CHANNELS, Array, Frame, Size

IMAGES = ("color", "depth", "motion", "reactive", "aovs", "motion_next", "ids")
"""Fields of a frame that are arrays."""
VALUES = ("jitter", "reset", "exposure", "pre_exposure")
"""Fields of a frame that are neither arrays nor G-buffers."""


class BufferField(NamedTuple):
    """The field of `Frame` and the key of a G-buffer; `str` gives gbuffer_display['normal']."""

    group: str
    key: str
    channels: int

    def __str__(self) -> str:
        return f"{self.group}[{self.key!r}]"

    @property
    def of_display(self) -> bool:
        """Whether it has display size."""
        return self.group == "gbuffer_display"

    def find(self, frame: Frame | RawFrame) -> Array | None:
        """Return the buffer; None if the frame lacks it."""
        buffers: Mapping[str, Array] = getattr(frame, self.group) or {}
        return buffers.get(self.key)

    def shape(self, render: Size, display: Size) -> tuple[int, ...]:
        """Return (h, w) or (h, w, 3)."""
        width, height = display if self.of_display else render
        return (height, width) if self.channels == 1 else (height, width, self.channels)


GBUFFERS: Mapping[str, BufferField] = {
    f"{group}_{key}": BufferField(group, key, channels)
    for group, known in (("gbuffer", GBUFFER_CHANNELS), ("gbuffer_display", GBUFFER_DISPLAY_CHANNELS))
    for key, channels in known.items()
}
"""All G-buffers, by tensor name."""
_ON_DEVICE = ("color", "depth", "motion", "reactive", *GBUFFERS)
"""Images of a frame on a device."""


def check_image_names(argument: str, names: Iterable[object]) -> None:
    """Raise FrameError unless all names are those of images: a misspelt mask would be ignored."""
    for name in names:
        if name not in _ON_DEVICE:
            want, hint = f"one of {', '.join(_ON_DEVICE)}", did_you_mean(name, _ON_DEVICE)
            raise FrameError(f"{argument}[{shown(name)}]", got="not an image's name", want=want, hint=hint)


def check_gbuffers(frame: Frame, names: Iterable[str], display_size: Size, method: str) -> None:
    """Raise FrameError if a G-buffer that the method reads is missing or has a wrong size.

    `names` are the inputs of the method. See `sampled` for buffers that may be missing.
    """
    names = tuple(names)
    required = lacking(names, gbuffer_arrays(frame))
    for name in names:
        place = GBUFFERS[name]
        array, want = place.find(frame), place.shape(frame.size, display_size)
        if name in required:
            where = "display size, at pixel centres without jitter" if place.of_display else "render size"
            hint = f"{method!r} reads it: render it at {where}, or choose a method that needs none."
            raise FrameError(str(place), got=None, want=want, hint=hint)
        if array is not None and array.shape != want:  # only display sizes: `Frame` has checked render sizes
            hint = f"Render it at the display size, {display_size[0]}x{display_size[1]}."
            raise FrameError(str(place), got=array.shape, want=want, hint=hint)


def twin_of(name: str) -> str | None:
    """Return the display-size buffer that replaces a missing render-size one if a method reads both.

    None for a display-size buffer; see `sampled`.
    """
    place = GBUFFERS[name]
    return None if place.of_display else f"gbuffer_display_{place.key}"


def lacking(names: Iterable[str], there: Collection[str]) -> list[str]:
    """Return the names of required buffers that are missing; one with a replacement is not required."""
    read = tuple(names)
    return [name for name in read if name not in there and twin_of(name) not in read]


def sampled(frame: Frame, names: Collection[str], display_size: Size) -> Frame:
    """Return the frame with all render-size buffers that a method reads.

    A missing one is sampled from the display-size buffer, at the pixel centre nearest to each sample. That is
    exact inside surfaces; along edges it may be another surface.

    The frame has passed `check_gbuffers`; `names` are the inputs of the method.
    """
    missing = [name for name in names if GBUFFERS[name].find(frame) is None]
    if not missing:
        return frame
    (w, h), (big_w, big_h) = frame.size, display_size
    columns, rows = (
        np.minimum(((np.arange(n) + 0.5 + offset) * (big / n)).astype(np.intp), big - 1)
        for n, big, offset in zip((w, h), (big_w, big_h), frame.jitter, strict=True)
    )
    buffers, found = frame.gbuffer_display or {}, dict(frame.gbuffer or {})
    for place in (GBUFFERS[name] for name in missing):
        found[place.key] = buffers[place.key].take(rows, axis=0).take(columns, axis=1)
    return replace(frame, gbuffer=found)


def gbuffer_arrays(frame: Frame | RawFrame) -> dict[str, Array]:
    """Return the G-buffers that a frame has, by tensor name."""
    if not (frame.gbuffer or frame.gbuffer_display):  # most frames have none
        return {}
    return {name: array for name, place in GBUFFERS.items() if (array := place.find(frame)) is not None}


def only_gbuffers(frame: Frame, names: Collection[str]) -> Frame:
    """Return the frame with only these G-buffers."""
    kept = {name: array for name, array in gbuffer_arrays(frame).items() if name in names}
    gbuffer, gbuffer_display = grouped(kept)
    return replace(frame, gbuffer=gbuffer, gbuffer_display=gbuffer_display)


def grouped(buffers: Mapping[str, Array]) -> tuple[Mapping[str, Array] | None, Mapping[str, Array] | None]:
    """Return a frame's `gbuffer` and `gbuffer_display` from buffers by tensor name; None for an empty one."""
    groups: dict[str, dict[str, Array]] = {"gbuffer": {}, "gbuffer_display": {}}
    for name, array in buffers.items():
        groups[GBUFFERS[name].group][GBUFFERS[name].key] = array
    return groups["gbuffer"] or None, groups["gbuffer_display"] or None


def arrays_by_name(frame: Frame) -> dict[str, Array]:
    """Return all arrays of a frame by tensor name."""
    found = {name: array for name in IMAGES if (array := getattr(frame, name)) is not None}
    return found | gbuffer_arrays(frame)


def values_of(source: object) -> dict[str, Any]:
    """Return the fields VALUES of a frame, or of a record that has them, by name."""
    return {name: getattr(source, name) for name in VALUES}


def frame_of(arrays: Mapping[str, Array], **values: Any) -> Frame:
    """Return a frame of arrays by tensor name, and of the fields VALUES.

    Raises:
        FrameError: depth or motion is missing, or see `Frame`.
    """
    gbuffer, gbuffer_display = grouped({name: arrays[name] for name in arrays if name in GBUFFERS})
    images: dict[str, Any] = {name: arrays.get(name) for name in IMAGES}
    return Frame(**images, gbuffer=gbuffer, gbuffer_display=gbuffer_display, **values)


def black(names: Iterable[str], render: Size, display: Size) -> Frame:
    """Return a frame of zeros with these G-buffers; sizes are (width, height)."""
    zeros = np.zeros((*render[::-1], 3), np.float32)
    images = {"color": zeros, "depth": zeros[..., 0], "motion": zeros[..., :2]}
    buffers = {name: np.zeros(GBUFFERS[name].shape(render, display), np.float32) for name in names}
    return frame_of(images | buffers, jitter=(0.0, 0.0))


def listed(names: Collection[str]) -> str:
    """Return a text such as "normal at render size; normal, depth at display size"."""
    keys: dict[str, list[str]] = {"gbuffer": [], "gbuffer_display": []}
    for name in names:
        keys[GBUFFERS[name].group].append(GBUFFERS[name].key)
    sizes = {"render": keys["gbuffer"], "display": keys["gbuffer_display"]}
    return "; ".join(f"{', '.join(found)} at {size} size" for size, found in sizes.items() if found) or "none"
