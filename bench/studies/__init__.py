"""One-off measurements that wrote a few tables of the documentation, and are in no wheel.

Each is a program for a development install: `python bench/studies/NAME.py --help`. Their records are in
bench/results/studies.
"""
