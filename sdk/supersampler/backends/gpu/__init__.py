"""GPU backend: the step as compute shaders in WGSL, on any GPU that wgpu supports.

Shared shaders are in `shaders/`, those of a method in `methods/<name>/shaders/`.
"""
