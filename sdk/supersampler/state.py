"""What an Upscaler remembers: `Memory`, while it runs, and `State`, a copy to keep or send."""

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


STATE_VERSION = 2
"""Version of what a State holds. Another one is refused: what its arrays mean may have changed."""


class Memory(NamedTuple):
    """What an Upscaler remembers. Replaced as a whole: an interrupted step changes all of it or nothing.

    Attributes:
        display_size: (width, height) of the images; with `scale` None until the first frame.
        history: for the next frame; None where there is none.
        spare: the history before, whose buffers the next step writes to.
        shaded: what unshaded frames are extrapolated from.
        stats: see `Upscaler`.
    """

    display_size: Size | None
    history: History | None = None
    spare: History | None = None
    shaded: ShadedHistory | None = None
    stats: Stats = Stats()


@dataclass(frozen=True)
class State:
    """A copy of an Upscaler's history; plain arrays and numbers, so it can be pickled or sent elsewhere.

    Attributes:
        method: whose history it is.
        display_size: (width, height) of the images.
        render_size: (width, height) of the previous frame; None where there is none.
        history: tensors by name; None where there is no history.
        shaded: tensors from which unshaded frames are extrapolated, likewise.
        version: STATE_VERSION of the package that saved it.
    """

    method: str
    display_size: Size | None
    render_size: Size | None
    history: Mapping[str, NDArray[Any]] | None
    shaded: Mapping[str, NDArray[Any]] | None = None
    version: int = field(default_factory=lambda: STATE_VERSION)  # not of the class: older pickles lack it

    def history_for(self, model: "Model", display_size: Size | None) -> History | None:
        """Return the history as a model takes it; None where there is none.

        Args:
            model: the model.
            display_size: (width, height) that it must be of; None takes any.

        Raises:
            ArgumentError: it is of another version, method or display size, or an array of its history is
                not as the model has it.
        """
        version = getattr(self, "version", None)
        if type(version) is not int or version != STATE_VERSION:
            hint = "Load it with the version of supersampler that saved it."
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
