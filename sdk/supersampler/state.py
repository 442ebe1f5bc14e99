"""What an Upscaler remembers, as a copy."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.history import History

if TYPE_CHECKING:
    from supersampler.model import Model


@dataclass(frozen=True)
class State:
    """A copy of an Upscaler's history; plain arrays and numbers, so it can be pickled or sent elsewhere.

    Attributes:
        method: whose history it is.
        display_size: (width, height) of the images.
        render_size: of the frame before; None where there is none.
        history: tensors by name; None where there is no past.
        shaded: what frames that are not shaded are drawn from, likewise.
    """

    method: str
    display_size: Size | None
    render_size: Size | None
    history: Mapping[str, NDArray[Any]] | None
    shaded: Mapping[str, NDArray[Any]] | None = None

    def history_for(self, model: "Model", display_size: Size | None) -> History | None:
        """Return the history as a model takes it; None where there is no past.

        Args:
            model: the model.
            display_size: (width, height) that it must be of; None takes any.

        Raises:
            ArgumentError: it is of another method or display size.
        """
        if self.method != model.info.method:
            raise ArgumentError("state", got=f"of {self.method!r}", want=f"of {model.info.method!r}")
        if display_size not in (None, self.display_size):
            raise ArgumentError("state", got=f"at {self.display_size}", want=f"at {display_size}")
        if self.history is None or self.display_size is None or self.render_size is None:
            return None
        return model.load_history(self.display_size, self.render_size, self.history)
