"""Type aliases of the arrays, colours and vectors in scenes."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Rng: TypeAlias = np.random.Generator
Values: TypeAlias = NDArray[np.float64]
Vector: TypeAlias = tuple[float, float, float]
Color: TypeAlias = tuple[float, float, float]
Matrix: TypeAlias = NDArray[np.float64]
"""(4, 4), row-major, acting on column vectors."""
Matrices: TypeAlias = NDArray[np.float64]
"""(n, 4, 4)."""
Points: TypeAlias = NDArray[np.float32]
Indices: TypeAlias = NDArray[np.uint32]
Joints: TypeAlias = NDArray[np.uint16]
Pixels: TypeAlias = NDArray[np.uint8]
