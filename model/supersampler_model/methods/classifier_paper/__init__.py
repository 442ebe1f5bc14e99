"""`classifier-paper`: Guo et al. 2022 to the letter, to compare with.

No weights ship for it.
"""
