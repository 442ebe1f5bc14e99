"""Measurement: quality, speed and stability against references, by one command.

Every number in README and docs is written from here; one-off studies live in bench/studies.
"""
