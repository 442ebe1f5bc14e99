"""The types of recorded calls, and `State` as JSON and arrays."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from numpy.typing import NDArray

from supersampler.frame import Float32, Frame
from supersampler.io.json_fields import Field
from supersampler.recording.outcome import Outcome
from supersampler.state import State

_SHADED = "shaded."  # prefix of the names of `State.shaded`


@dataclass(frozen=True, eq=False)
class StepCall:
    """`Upscaler.step`, `extrapolate` or `step_tensors`.

    Attributes:
        index: number of steps before it, refused ones included.
        frame: the frame, without G-buffers that the model does not read.
        outputs: names of the requested auxiliary outputs.
        tensors: whether it was `step_tensors`, which checks no pixels.
        extrapolated: whether it was `extrapolate`.
        outcome: what it returned or raised; None where the process ended during the step or right after it.
    """

    index: int
    frame: Frame
    outputs: tuple[str, ...]
    tensors: bool
    extrapolated: bool
    outcome: Outcome | None


@dataclass(frozen=True)
class ResetCall:
    """`Upscaler.reset`."""


@dataclass(frozen=True, eq=False)
class LoadStateCall:
    """`Upscaler.load_state`."""

    state: State


@dataclass(frozen=True, eq=False)
class CloseCall:
    """`Upscaler.close`. It is missing where the process ended before, or still runs.

    Attributes:
        image: (H, W, 3) the last image; None where there is none.
    """

    image: Float32 | None


Call: TypeAlias = StepCall | ResetCall | LoadStateCall | CloseCall


def state_json(state: State) -> dict[str, Any]:
    """Return a state as JSON values; of `history` and `shaded` only whether they are there."""
    flags = {name: getattr(state, name) is not None for name in ("history", "shaded")}
    return {**vars(state), **flags}


def state_arrays(state: State) -> dict[str, NDArray[Any]]:
    """Return the arrays of a state by name; those of `State.shaded` are shaded.NAME."""
    shaded = {f"{_SHADED}{name}": array for name, array in (state.shaded or {}).items()}
    return {**(state.history or {}), **shaded}


def state_of(data: Field, arrays: Mapping[str, NDArray[Any]]) -> State:
    """Return the state of `state_json` and `state_arrays`, whose arrays `Upscaler.load_state` checks."""
    shaded = {n.removeprefix(_SHADED): array for n, array in arrays.items() if n.startswith(_SHADED)}
    history = {n: array for n, array in arrays.items() if not n.startswith(_SHADED)}
    return State(
        data["method"].of(str),
        data.read("display_size", Field.size, None),
        data.read("render_size", Field.size, None),
        history if data["history"].flag() else None,
        shaded if data["shaded"].flag() else None,
        data["version"].of(int),
    )
