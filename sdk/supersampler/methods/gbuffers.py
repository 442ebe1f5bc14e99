"""G-buffers by tensor name: gbuffer_display_normal is `frame.gbuffer_display["normal"]`."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from supersampler.conventions import RawFrame
from supersampler.errors import FrameError
from supersampler.frame import GBUFFER_CHANNELS, GBUFFER_DISPLAY_CHANNELS, Array, Frame, Size

IMAGES = ("color", "depth", "motion", "reactive", "aovs", "motion_next")
"""Fields of a frame that are arrays."""


class BufferField(NamedTuple):
    """The field and key of a G-buffer in a frame; `str` gives gbuffer_display['normal']."""

    group: str  # the frame's field
    key: str
    channels: int

    def __str__(self) -> str:
        return f"{self.group}[{self.key!r}]"

    @property
    def of_display(self) -> bool:
        """Whether it has display size."""
        return self.group == "gbuffer_display"

    def find(self, frame: Frame | RawFrame) -> Array | None:
        """The buffer; None where the frame lacks it."""
        buffers: Mapping[str, Array] = getattr(frame, self.group) or {}
        return buffers.get(self.key)

    def shape(self, render: Size, display: Size) -> tuple[int, ...]:
        """(h, w) or (h, w, 3)."""
        width, height = display if self.of_display else render
        return (height, width) if self.channels == 1 else (height, width, self.channels)


GBUFFERS: Mapping[str, BufferField] = {
    f"{group}_{key}": BufferField(group, key, channels)
    for group, known in (("gbuffer", GBUFFER_CHANNELS), ("gbuffer_display", GBUFFER_DISPLAY_CHANNELS))
    for key, channels in known.items()
}
"""All G-buffers, by tensor name."""


def check_gbuffers(frame: Frame, names: Iterable[str], display_size: Size, method: str) -> None:
    """Raise FrameError if a G-buffer is missing or has a wrong size; see `sampled` for what may be missing.

    `names` are the inputs of the method; other buffers of the frame are not checked.
    """
    names = tuple(names)
    for name, place in ((name, GBUFFERS[name]) for name in names):
        array, want = place.find(frame), place.shape(frame.size, display_size)
        if array is None and twin_of(name) in names:
            continue
        if array is None:
            where = "display size, at pixel centres without jitter" if place.of_display else "render size"
            hint = f"{method!r} reads it: render it at {where}, or choose a method that needs none."
            raise FrameError(str(place), got=None, want=want, hint=hint)
        if array.shape != want:  # `Frame` has checked those of render size
            hint = f"It does not have the display size, {display_size[0]}x{display_size[1]}: render it so."
            raise FrameError(str(place), got=array.shape, want=want, hint=hint)


def twin_of(name: str) -> str | None:
    """Tensor name of the display-size buffer that stands in for one of render size; None for the others.

    It does so where a method reads both; see `sampled`.
    """
    place = GBUFFERS[name]
    twin = f"gbuffer_display_{place.key}"
    return None if place.of_display or twin not in GBUFFERS else twin


def lacking(names: Iterable[str], there: Collection[str]) -> list[str]:
    """Return the names of required buffers that are missing; one that has a stand-in is not required."""
    read = tuple(names)
    return [name for name in read if name not in there and twin_of(name) not in read]


def sampled(frame: Frame, names: Collection[str], display_size: Size) -> Frame:
    """Return the frame with all render-size buffers of these names.

    A missing one is read from the buffer of display size, at the pixel whose centre is nearest to each
    sample: exact on surfaces that fill a pixel, and another surface's along edges.

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


def names_of(frame: Frame | RawFrame) -> list[str]:
    """Tensor names of the G-buffers that a frame has."""
    return [name for name, place in GBUFFERS.items() if place.find(frame) is not None]


def only_gbuffers(frame: Frame, names: Collection[str]) -> Frame:
    """Return the frame without G-buffers other than these."""
    there = names_of(frame)
    if set(there) <= set(names):
        return frame
    found = {name: GBUFFERS[name].find(frame) for name in there if name in names}
    kept = {name: array for name, array in found.items() if array is not None}
    gbuffer, gbuffer_display = grouped(kept)
    return replace(frame, gbuffer=gbuffer, gbuffer_display=gbuffer_display)


def grouped(buffers: Mapping[str, Array]) -> tuple[Mapping[str, Array] | None, Mapping[str, Array] | None]:
    """Group buffers by tensor name into a frame's `gbuffer` and `gbuffer_display`; None: there are none."""
    groups: dict[str, dict[str, Array]] = {"gbuffer": {}, "gbuffer_display": {}}
    for name, array in buffers.items():
        groups[GBUFFERS[name].group][GBUFFERS[name].key] = array
    return groups["gbuffer"] or None, groups["gbuffer_display"] or None


def arrays_by_name(frame: Frame) -> dict[str, Array]:
    """Return the arrays that a frame has, by tensor name."""
    images = {name: getattr(frame, name) for name in IMAGES if getattr(frame, name) is not None}
    return images | {name: GBUFFERS[name].find(frame) for name in names_of(frame)}


def frame_of(arrays: Mapping[str, Array], **values: Any) -> Frame:
    """Return the frame that has these arrays, by tensor name, and other values of `Frame`.

    Raises:
        FrameError: depth or motion is missing, or an array is not as in `Frame`.
    """
    gbuffer, gbuffer_display = grouped({name: arrays[name] for name in arrays if name in GBUFFERS})
    images: dict[str, Any] = {name: arrays.get(name) for name in IMAGES}
    return Frame(**images, gbuffer=gbuffer, gbuffer_display=gbuffer_display, **values)


def black(names: Iterable[str], render: Size, display: Size) -> Frame:
    """Return a frame of zeros with these G-buffers; sizes are (width, height)."""
    zeros = np.zeros((*render[::-1], 3), np.float32)
    buffers = {name: np.zeros(GBUFFERS[name].shape(render, display), np.float32) for name in names}
    gbuffer, gbuffer_display = grouped(buffers)
    return Frame(
        color=zeros,
        depth=zeros[..., 0],
        motion=zeros[..., :2],
        jitter=(0.0, 0.0),
        gbuffer=gbuffer,
        gbuffer_display=gbuffer_display,
    )


def listed(names: Collection[str]) -> str:
    """Return a text such as "normal at render size; normal, depth at display size"."""
    places = [GBUFFERS[name] for name in names]
    texts = []
    for of_display, size in ((False, "render"), (True, "display")):
        keys = [place.key for place in places if place.of_display == of_display]
        texts += [f"{', '.join(keys)} at {size} size"] if keys else []
    return "; ".join(texts) or "none"
