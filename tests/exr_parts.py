"""Image files as OpenImageIO writes them, of one or several parts."""

from pathlib import Path

import numpy as np
from OpenImageIO import ImageOutput, ImageSpec


def write_parts(path: Path, *parts: tuple[ImageSpec, np.ndarray]) -> Path:
    """Write the pixels of each part, or page, with its specification."""
    path.parent.mkdir(parents=True, exist_ok=True)
    output = ImageOutput.create(str(path))
    assert output is not None
    assert output.open(str(path), tuple(spec for spec, _ in parts) if len(parts) > 1 else parts[0][0])
    for index, (spec, values) in enumerate(parts):
        assert index == 0 or output.open(str(path), spec, "AppendSubimage")
        assert output.write_image(np.ascontiguousarray(values))
    assert output.close()
    return path
