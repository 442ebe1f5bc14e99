"""The public test shots: what they are, how they are rendered, and the hashes that identify their pixels.

Scenes and the renderer are in `supersampler_model.data`.
"""
