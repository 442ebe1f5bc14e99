"""`supersampler bench`: one module for each group of commands, which parse options, call and print.

No measurement and no statistics here; the main command looks for `app` in this package.
"""

from supersampler_bench.cli.app import app

__all__ = ["app"]
