"""Whether two runs agree: backends with torch, one version with another, one record with an earlier one.

References are not used here; see `quality`.
"""
