"""A static test scene: fine waves, a zone plate, a check pattern and a thin line.

`bench still` measures convergence on it. One frame at ratio 2 undersamples its waves and rings, so a method
needs several jittered frames to resolve them; one jitter period suffices, as the patterns are smooth.
Sizes and contrasts were chosen on 2026-11-23 so that at 160x90 to 320x180 the methods that never converged
(commit 571eab6) reach, in the fourth period, 35.0 dB (`taau`) and 34.2 dB (`classifier`).
"""

import numpy as np

from supersampler_model.data.scenes.analytic import DiscOverPlane, Plane, Values, grey

WAVES_END, RINGS_END, CHECKS_END = 18.0, 46.0, 18.0
"""Units: waves are left of the first, rings between the two; right of them checks above the last, a line
below."""
WAVELENGTH = 1.1
RING_MIDDLE, RINGS_FINEST = (32.0, 18.0), 0.75
CHECK_SIDE = 6.0
LINE_HALF_WIDTH = 0.1
_DIRECTIONS = ((0.9, 0.4, 0.0), (0.3, 0.9, 1.0), (-0.6, 0.8, 2.0))


def still_life(x: Values, y: Values) -> Values:
    """Return the colours: a `Pattern`."""
    left = np.where((x < WAVES_END)[..., None], _waves(x, y), _rings(x, y))
    right = np.where((y < CHECKS_END)[..., None], _checks(x, y), _line(x, y))
    return np.where((x < RINGS_END)[..., None], left, right)


def still_scene() -> Plane:
    """Return the pattern under a static camera."""
    return Plane(still_life)


def still_scene_with_mover() -> DiscOverPlane:
    """Return the same scene with a disc that crosses its upper half from left to right."""
    return DiscOverPlane(
        velocity=(0.5, 0.0),
        background_velocity=(0.0, 0.0),
        start=(-4.0, 8.0),
        radius=4.0,
        pattern=still_life,
    )


def _waves(x: Values, y: Values) -> Values:
    phases = [2.0 * np.pi * (a * x + b * y) / WAVELENGTH + start for a, b, start in _DIRECTIONS]
    return 0.45 + 0.35 * np.sin(np.stack(phases, axis=-1))


def _rings(x: Values, y: Values) -> Values:
    """Rings that are ever finer outwards, RINGS_FINEST apart 20 units from the middle."""
    dx, dy = x - RING_MIDDLE[0], y - RING_MIDDLE[1]
    return grey(0.5 + 0.45 * np.cos(np.pi * (dx * dx + dy * dy) / (20.0 * RINGS_FINEST)))


def _checks(x: Values, y: Values) -> Values:
    turned = np.cos(0.35) * x + np.sin(0.35) * y, np.cos(0.35) * y - np.sin(0.35) * x
    odd = sum(np.floor(v / CHECK_SIDE).astype(int) for v in turned) % 2
    return np.where(odd[..., None] == 1, (0.55, 0.4, 0.15), (0.2, 0.2, 0.25))


def _line(x: Values, y: Values) -> Values:
    away = np.abs(np.sin(0.3) * (x - 55.0) - np.cos(0.3) * (y - 27.0))
    behind = grey(0.2 + 0.1 * np.sin(x / 5.0))
    return np.where((away < LINE_HALF_WIDTH)[..., None], (1.0, 0.9, 0.7), behind)
