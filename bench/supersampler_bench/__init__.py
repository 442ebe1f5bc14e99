"""Measurement: quality, speed and stability against references, by one command.

Every number in README and docs is written by these commands.
"""
