"""Scenes to render: procedural families, glTF assets, and analytic ones without a renderer.

Geometry, materials, lights and motion; pixels are `data.renderer`'s.
"""
