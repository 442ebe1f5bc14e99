"""The `supersampler bench` commands, one module for each group: parse options, measure, print.

Measurements and statistics are in the other packages. The main command loads `app` from here.
"""

from supersampler_bench.cli.app import app

__all__ = ["app"]
