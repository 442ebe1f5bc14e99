"""Doors into other people's programs, one module each; nothing but cli imports them.

Each imports the program's own package, which the SDK does not depend on.
"""
