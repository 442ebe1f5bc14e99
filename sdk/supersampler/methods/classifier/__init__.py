"""`classifier` and related methods: a network predicts classes and blend weights (Guo et al. 2022)."""
