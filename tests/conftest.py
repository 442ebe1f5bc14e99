"""Settings of all tests."""

from hypothesis import settings

# No time limit an example, as machines are busy; the same examples each time: a merge is no matter of luck.
settings.register_profile("steady", deadline=None, derandomize=True)
settings.load_profile("steady")
