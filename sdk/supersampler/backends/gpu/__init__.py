"""The GPU backend: compute shaders in WGSL. Methods have their own in `methods/<name>/shaders`."""
