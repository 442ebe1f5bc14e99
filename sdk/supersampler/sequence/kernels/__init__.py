"""Kernels of sequences, and the structs and constants that they share with Python."""
