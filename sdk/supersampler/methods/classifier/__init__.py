"""`classifier` and its relatives: a network predicts classes and blend weights (Guo et al. 2022)."""
