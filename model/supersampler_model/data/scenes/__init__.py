"""Scenes to render: procedural families, glTF assets, and analytic ones without a renderer.

They hold geometry, materials, lights and motion; `data.renderer` renders them.
"""
