"""The CPU backend: kernel loader, threads, tiles, and the kernels and stages that methods share.

A stage of one method lives in `methods/<name>/cpu.py`, its kernels beside it.
"""
