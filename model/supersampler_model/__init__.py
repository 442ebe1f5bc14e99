"""The methods as torch modules, their training data, losses and training. Needs the `train` extra.

The definition of what each method computes; `supersampler` runs what `supersampler_export` makes of it.
"""
