"""The state of an Upscaler: `Memory` while it runs, and `State`, a copy to store or send."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from numpy.typing import NDArray

from supersampler.arguments import checked_size
from supersampler.errors import ArgumentError
from supersampler.extrapolation import ShadedHistory
from supersampler.frame import Size
from supersampler.history import History, Stats

if TYPE_CHECKING:
    from supersampler.model import Model


STATE_VERSION = 4
"""Version of the contents of a State. Other versions are refused: the meaning of arrays may differ."""


class Memory(NamedTuple):
    """State between frames. Replaced as a whole, so that an interrupted step changes all of it or nothing.

    Attributes:
        display_size: (width, height) of the images; with `scale`, None before the first frame.
        history: history for the next frame; None at a start or after a reset.
        spare: the history before that one; the next step writes to its buffers.
        shaded: history from which unshaded frames are extrapolated.
        stats: see `Upscaler`.
    """

    display_size: Size | None
    history: History | None = None
    spare: History | None = None
    shaded: ShadedHistory | None = None
    stats: Stats = Stats()


@dataclass(frozen=True)
class State:
    """A copy of an Upscaler's history as plain arrays and numbers, which can be pickled or sent.

    Attributes:
        method: name of the method.
        display_size: (width, height) of the images.
        render_size: (width, height) of the previous frame; None without a history.
        history: tensors by name; None without a history.
        shaded: tensors from which unshaded frames are extrapolated; None without a shaded frame.
        version: STATE_VERSION of the package that saved it.
    """

    method: str
    display_size: Size | None
    render_size: Size | None
    history: Mapping[str, NDArray[Any]] | None
    shaded: Mapping[str, NDArray[Any]] | None = None
    version: int = field(default_factory=lambda: STATE_VERSION)  # no class attribute: old pickles lack it

    def history_for(self, model: "Model", display_size: Size | None) -> History | None:
        """Return the history for a model; None if the state has none.

        Args:
            model: the model.
            display_size: required (width, height) of the images; None accepts any.

        Raises:
            ArgumentError: the version, the method, the display size or an array does not match.
        """
        version = getattr(self, "version", None)
        if type(version) is not int or version != STATE_VERSION:
            hint = "Load it with the version of supersampler that saved it, or start without a state."
            raise ArgumentError("state", got=f"of version {version!r}", want=f"{STATE_VERSION}", hint=hint)
        if self.method != model.info.method:
            raise ArgumentError("state", got=f"of {self.method!r}", want=f"of {model.info.method!r}")
        own = None if self.display_size is None else checked_size("state.display_size", self.display_size)
        if display_size not in (None, own):
            raise ArgumentError("state", got=f"at {self.display_size}", want=f"at {display_size}")
        if self.history is None:
            return None
        if own is None or self.render_size is None:
            want = "both with a history"
            raise ArgumentError("state", got="without display_size or render_size", want=want)
        return model.load_history(own, self.render_size, self.history)
