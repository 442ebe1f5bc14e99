"""The methods as torch modules, and later their data, losses and training. Needs the `train` extra."""
