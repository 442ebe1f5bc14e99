"""Training and test data: scenes, the renderer, references and labels, datasets.

It does not depend on the methods.
"""
