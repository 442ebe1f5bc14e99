"""`classifier-paper`: the form of the supplement of Guo et al. 2022, for comparison with `classifier`.

Its weights are in bench/weights, not in the package; docs/methods.md lists its departures from that form.
"""
