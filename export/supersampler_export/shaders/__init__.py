"""Shaders of a method as a folder for engines: code, weights, and upscaler.json, which says how to run them.

Nothing here imports torch, and nothing needs a GPU.
"""
