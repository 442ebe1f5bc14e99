"""Recognise channels that hold ids, by their names and by Cryptomatte's entries in the header."""

import re
from collections.abc import Collection

_ID = re.compile(
    r"""index.*|(object|material|prim|shape|face|mesh|instance)[ _]?index  # Blender, Mitsuba
    |(.*[_ -])?(id|ID|Id)s?\d*|.*[a-z0-9]I[Dd]s?\d*          # id2, object_id, RenderID
    |(object|material|instance|render|node|prim|primitive|mesh|face|group|particle|shader)ids?\d*
    |(raw|primvar|sampleprim)id                               # RenderMan, Karma""",
    re.VERBOSE,
)
"""Names of ids other than Cryptomatte's. `grid` is none."""


def is_id(channel: str, cryptomattes: Collection[str] = ()) -> bool:
    """Return whether a channel holds ids, by its name, or of one of these Cryptomatte layers."""
    base = base_name(channel)
    if "crypto" in channel.lower() or _ID.fullmatch(base) or _ID.fullmatch(base.lower()):
        return True
    return is_of_cryptomatte(channel, cryptomattes)


def is_of_cryptomatte(channel: str, cryptomattes: Collection[str]) -> bool:
    """Return whether a channel is of one of these Cryptomatte layers: `NAME00.R`, also after others."""
    layer = channel.rpartition(".")[0]
    ends = range(len(layer.rstrip("0123456789")), len(layer) + 1)
    begins = [0, *(found.end() for found in re.finditer(r"\.", layer))]
    return not {layer[begin:end] for begin in begins for end in ends}.isdisjoint(cryptomattes)


def base_name(channel: str) -> str:
    """Return the name before a channel's last dot, without layers: `Z` of `a.Z.R`, and of `Z`."""
    *before, last = channel.split(".")
    return before[-1] if before else last
