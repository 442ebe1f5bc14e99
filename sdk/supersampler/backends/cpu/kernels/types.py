"""What kernels take beside int (64 bits) and float (32): pointers to arrays that are C-contiguous."""


class Floats:
    """float32."""


class Halves:
    """Half floats."""


class Bytes:
    """uint8."""


class Words:
    """int32, or four bytes each."""
