"""Blender: a script that renders frames inside Blender, the process around it, and an extension.

`render_frames.py` runs in Blender's own Python and imports nothing of this package.
"""
