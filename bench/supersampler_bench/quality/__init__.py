"""Image quality against references: metrics, the pass over a shot, its scores, tables and figures.

Nothing here measures time; see `timing`.
"""
