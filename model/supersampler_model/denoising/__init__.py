"""The temporal denoiser of path-traced frames: its definition, and the training of its weights."""
