"""The renderer: forward shading on OpenGL 4.5, without a window, on a GPU or in software.

Input: a scene and a jitter. Output: jittered frames, references of many samples per pixel, G-buffers.
"""
