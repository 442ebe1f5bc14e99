"""Shaders of a method as a folder for engines. Needs neither torch nor a GPU."""
