"""The host executor: steps as compiled kernels on this processor, for methods that have them."""
