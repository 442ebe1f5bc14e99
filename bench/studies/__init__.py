"""Programs for maintainers, in no wheel: ablations of methods, and hashes of all images.

Each runs in a development install: `python bench/studies/NAME.py --help`. Records are in
bench/results/studies.
"""
