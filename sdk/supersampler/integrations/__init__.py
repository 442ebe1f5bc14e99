"""Integrations with other programs: Blender, PyVista and VTK. Inside the SDK, only `cli` imports them.

Each imports the program's own package, which the SDK does not depend on.
"""
