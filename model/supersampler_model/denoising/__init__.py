"""The definition of the temporal denoiser of path-traced frames."""
