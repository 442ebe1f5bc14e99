"""The renderer: forward shading on OpenGL 4.5, without a window, on a GPU or in software.

It draws samples, truth and G-buffers of a scene; it chooses no scene and no jitter.
"""
