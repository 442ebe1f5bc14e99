"""`guided-warp` and `guided-flow`: the colour of unshaded frames (ExtraSS, Wu et al. 2023)."""
