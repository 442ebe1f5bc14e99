"""The CPU backend: kernel loader, threads, tiles, and the kernels that several methods use.

Stages and kernels of one method are in `methods/<name>/`.
"""
