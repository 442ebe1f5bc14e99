"""The CPU backend: the C++ library of sdk/native, called by ctypes."""
