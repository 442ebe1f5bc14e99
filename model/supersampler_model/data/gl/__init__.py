"""The renderer: forward shading on OpenGL 4.5, without a window, on a GPU or in software."""
