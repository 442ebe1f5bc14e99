"""Agreement of backends with torch, of one version with another, and of a record with an earlier one.

References are not used here; see `quality`.
"""
