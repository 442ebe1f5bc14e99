"""Blender: a script that renders jittered frames inside Blender, and the process around it.

`render_frames.py` runs in Blender's own Python and imports nothing of this package.
"""
