"""`classifier-paper`: Guo et al. 2022 as published, for comparison with `classifier`.

No weights are released for it.
"""
