"""The renderer: forward shading on OpenGL 4.5, without a window, on a GPU or in software.

It renders samples, references and G-buffers of a scene; scenes and jitter come from the caller.
"""
