"""What numba compiles: the steps of the methods, for vectors of sixteen pixels."""
