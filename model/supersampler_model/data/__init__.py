"""Training and test data: scenes, the renderer, references and labels, datasets.

Nothing here knows a method.
"""
