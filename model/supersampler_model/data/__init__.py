"""Training and test data: scenes, the renderer that draws them with exact truth, labels, datasets.

Nothing here knows a method.
"""
