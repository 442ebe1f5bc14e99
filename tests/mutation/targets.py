"""Modules to mutate, and the tests that may notice. The only place that knows where modules lie."""

TARGETS = [
    "model/supersampler_model/methods/**/*.py",
    "model/supersampler_model/training/losses.py",
    "model/supersampler_model/training/*task*.py",
    "model/supersampler_model/data/labels.py",
    "export/supersampler_export/*.py",
    "sdk/supersampler/conventions/*.py",
    "sdk/supersampler/validation/*.py",
]
"""Globs from the root of the repository."""

EXCLUDED = [
    "export/supersampler_export/cli.py",  # help texts
    "tests/export/test_export_traced.py",  # traces for minutes
]
"""Globs of what is left out of both."""

TESTS = [
    "tests/model/*.py",
    "tests/model/train/*.py",
    "tests/model/data/test_label*.py",
    "tests/model/data/test_class_map.py",
    "tests/model/data/test_thin.py",
    "tests/export/*.py",
    "tests/sdk/test_backward_motion.py",
    "tests/sdk/test_bad_arguments.py",
    "tests/sdk/test_camera_motion.py",
    "tests/sdk/test_checks*.py",
    "tests/sdk/test_*_checks.py",
    "tests/sdk/test_conventions*.py",
    "tests/sdk/test_detect*.py",
    "tests/sdk/test_extrapolat*.py",
    "tests/sdk/test_gbuffers.py",
    "tests/sdk/test_jitter.py",
    "tests/sdk/test_planted_mistakes.py",
    "tests/test_golden*.py",
]
"""Globs of test files. Those that reach no target cost time and find nothing."""

STRONG = ["tests/export/test_shipped_steps.py"]
"""Files whose tests compare all results of a step: they run first, though others are quicker."""

PACKAGES = ["sdk", "model", "export", "bench"]
"""Folders that packages are imported from."""
