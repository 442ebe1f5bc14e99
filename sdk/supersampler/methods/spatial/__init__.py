"""`bilinear` and `bicubic`: interpolation of each frame alone."""
