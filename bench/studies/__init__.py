"""Programs for maintainers, in no wheel: one-off measurements, and checks of one version against another.

Each runs in a development install: `python bench/studies/NAME.py --help`. Their records are in
bench/results/studies.
"""
