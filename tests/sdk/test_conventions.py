"""Conventions: there and back again over all fields, the vendors' own formulas, and what is refused."""

import json
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from supersampler.conventions import Conventions, RawFrame
from supersampler.conventions.depth import DepthKind
from supersampler.errors import ArgumentError, FrameError
from supersampler.frame import Frame, Size
from supersampler.jitter import jittered_projection

PRESETS: list[Callable[..., Conventions]] = [
    Conventions, Conventions.fsr, Conventions.xess, Conventions.streamline, Conventions.unreal,
    Conventions.unity, Conventions.blender, Conventions.arm_gym,
]  # fmt: skip
NEAR, FAR = 0.1, 100.0


@st.composite
def any_conventions(draw: st.DrawFn) -> Conventions:
    kinds: list[DepthKind] = ["reversed_infinite", "reversed", "forward_infinite", "forward", "linear"]
    depth = draw(st.sampled_from(kinds))
