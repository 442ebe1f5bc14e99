"""`gbuffer-fast`: the classifier on light that G-buffers of display size guide."""
