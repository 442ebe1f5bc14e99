"""Settings of hypothesis for tests whose cases are seeds or sequences of frames."""

import os

from hypothesis import HealthCheck, settings

from fuzzing import examples


def random_cases(few: int) -> settings:
    """Return settings for the same `few` cases each time, or for SUPERSAMPLER_FUZZ random ones."""
    return settings(
        max_examples=examples(few),
        derandomize="SUPERSAMPLER_FUZZ" not in os.environ,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
