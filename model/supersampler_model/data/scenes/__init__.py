"""Scenes to render: procedural families, and analytic ones without a renderer.

They hold geometry, materials, lights and motion; `data.renderer` renders them.
"""
