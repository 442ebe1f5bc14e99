"""The shots inside this package."""

from pathlib import Path

from supersampler.arguments import checked_choice
from supersampler.io.shot.format import FILE_NAME
from supersampler.io.shot.shot import Shot

SHIPPED = "plaza"
"""The name of the one that demonstrations and tests use."""
_FOLDER = Path(__file__).parents[2] / "shots"


def shipped_shot(name: str = SHIPPED) -> Shot:
    """Open a shot that ships with this package.

    Raises:
        ArgumentError: there is none of that name; the message lists those there are.
    """
    names = sorted(path.parent.name for path in _FOLDER.glob(f"*/{FILE_NAME}"))
    return Shot.open(_FOLDER / checked_choice("name", name, names))
