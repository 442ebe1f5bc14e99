"""Measurement: quality, speed and stability against references, by one command.

Every number in README and docs is written by these commands.

Terms of all modules: `render` and `display` are the (width, height) of frames and of images, `ratio` is
display over render size, `methods` are names of shipped models or model folders. `on_frame`, `on_round` and
the like are called after each one, `on_left_out` with a sentence that says why a method is left out.
Times are milliseconds unless stated otherwise.
"""
