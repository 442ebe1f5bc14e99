"""`gbuffer-fast`: `classifier` on lighting that display-size G-buffers guide."""
