"""Memory and time that an extrapolated frame takes."""

import subprocess
import sys

import pytest

_LARGE = """
import resource
import numpy as np
from supersampler import Frame
from supersampler.extrapolation import Extrapolator
h, w = 540, 960
ones = np.full((h, w, 3), 0.5, np.float32)
frame = dict(depth=ones[..., 0], motion=ones[..., :2], jitter=(0.0, 0.0),
             gbuffer={"base_color": ones, "normal": ones})
model = Extrapolator("guided-warp", ["CPUExecutionProvider"], 1)
past = model.after_shaded(Frame(color=ones, **frame))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
color, _ = model.extrapolate(Frame(color=None, **frame), past)
assert np.allclose(color, 0.5, rtol=1e-4)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="counts in kilobytes")
def test_a_frame_of_960x540_takes_less_than_a_gigabyte() -> None:
    done = subprocess.run([sys.executable, "-c", _LARGE], capture_output=True, text=True, check=True)
    assert int(done.stdout) < 800_000
