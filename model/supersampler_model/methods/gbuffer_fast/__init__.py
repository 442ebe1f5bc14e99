"""`gbuffer-fast`: the classifier on light that G-buffers of display size guide.

Its surfaces (`surfaces`), and the stages around the classifier's network (`model`).
"""
