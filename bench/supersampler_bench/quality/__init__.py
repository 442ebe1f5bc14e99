"""Image quality against references: metrics, measurement of shots, scores and their tables."""
