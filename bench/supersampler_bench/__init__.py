"""Measurement: quality against references, by one command, so that no number is typed by hand."""
