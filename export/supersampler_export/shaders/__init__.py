"""The shaders of a method as a folder that engines load: sources, weights, and upscaler.json, which says how to run them.

Nothing here imports torch, and nothing needs a GPU.
"""
