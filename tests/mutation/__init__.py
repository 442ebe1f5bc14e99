"""`make mutation`: changes one place of the code at a time and says which changes no test notices.

A script of our own: mutmut puts a dispatcher in front of each function, which torch.export would trace, and
cosmic-ray runs the same command, so the whole suite, for each mutant.
"""
