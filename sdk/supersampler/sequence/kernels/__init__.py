"""Kernels of sequences, and the structs and constants that they share with Python.

Motion to the next frame is in scatter.py, the mean of two images in merge.py.
"""
