"""Camera and props of a VTK renderer at one frame, and depth and motion computed from them."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkProp3D

from supersampler.conventions import camera_motion
from supersampler.conventions.encodings import to_reversed_infinite
from supersampler.frame import Float32, Size

Matrix = NDArray[np.float64]

_JUMP = 0.5  # of the image: a median motion beyond it is another view
_TURN = np.cos(np.radians(30.0))  # of the angle between two frames' view directions, likewise
_TILE = 16  # pixels; side of the tiles in which the background moves with a surface
_THIN = 32  # largest number of a tile's samples that a surface two samples wide has
_PROBED = 16  # pixels between those whose motion is read for it


@dataclass(frozen=True, slots=True)
class View:
    """Camera and props at one frame.

    Attributes:
        size: (width, height) of the render.
        jitter: see `Frame`.
        view_projection: without jitter, to a clip space from -1 to 1.
        near: distance of the near plane; of the far plane `far`.
        parallel: whether the projection is parallel.
        matrices: of the props, from their own space to the world's.
    """

    size: Size
    jitter: tuple[float, float]
    view_projection: Matrix
    near: float
    far: float
    parallel: bool
    matrices: dict[vtkProp3D, Matrix]

    @classmethod
    def of(cls, renderer: Any, size: Size, jitter: tuple[float, float]) -> Self:
        """Read the view of a renderer whose viewport has the size, before the camera is jittered."""
        camera = renderer.GetActiveCamera()
        aspect = renderer.GetTiledAspectRatio()
        matrix = _array(camera.GetCompositeProjectionTransformMatrix(aspect, -1.0, 1.0))
        near, far = camera.GetClippingRange()
        props = [p for p in renderer.GetViewProps() if isinstance(p, vtkProp3D) and p.GetVisibility()]
        matrices = {prop: _array(prop.GetMatrix()) for prop in props}
        return cls(size, jitter, matrix, near, far, bool(camera.GetParallelProjection()), matrices)

    def frame_depth(self, buffer: Float32, unit: float) -> Float32:
        """Return unit / view distance of the depth buffer's values, 0 at the background."""
        if self.parallel:  # planes may lie behind the camera: distances count from the near plane
            range_ = self.far - self.near
            distance = np.float32(unit) / (np.float32(range_) * (buffer + np.float32(0.1)))
            return np.where(buffer < 1.0, distance, np.float32(0.0))
        depth = to_reversed_infinite(buffer, "forward", self.near, self.far)
        depth *= np.float32(unit / self.near)
        depth *= buffer < 1.0
        return depth

    def motion(self, buffer: Float32, previous: "View") -> Float32:
        """Return `Frame.motion` of props that do not move: that of the camera."""
        return self._motion(buffer, previous.view_projection)

    def moved_props(
        self, buffer: Float32, previous: "View"
    ) -> Iterator[tuple[Collection[vtkProp3D], Float32]]:
        """Yield props with a common movement, and the motion of each pixel if it shows one of them."""
        moves: dict[bytes, list[vtkProp3D]] = {}
        for prop, matrix in self.matrices.items():
            before = previous.matrices.get(prop)
            if before is not None and not np.array_equal(before, matrix):
                move = before @ np.linalg.inv(matrix)
                moves.setdefault(move.round(12).tobytes(), []).append(prop)
        for props in moves.values():
            move = previous.matrices[props[0]] @ np.linalg.inv(self.matrices[props[0]])
            yield props, self._motion(buffer, previous.view_projection @ move)

    def is_jump(self, motion: Float32, previous: "View") -> bool:
        """Return whether the camera jumped, so that the previous image is of no use."""
        if self.parallel != previous.parallel or self.size != previous.size:
            return True
        ahead, before = (view.view_projection[2, :3] for view in (self, previous))  # the view directions
        if ahead @ before < _TURN * np.linalg.norm(ahead) * np.linalg.norm(before):
            return True
        probes = np.abs(motion[::_PROBED, ::_PROBED]) / np.array(self.size, np.float32)
        return bool(np.median(probes.max(axis=-1)) > _JUMP)

    def _motion(self, buffer: Float32, previous: Matrix) -> Float32:
        return camera_motion(
            buffer, self.view_projection, previous, jitter=self.jitter, clip="minus_one_to_one"
        )


def move_background(vectors: NDArray[np.uint64], buffer: Float32) -> None:
    """Give the background of each tile the motion of the tile's closest surface, or 0 if it has few samples.

    Outlines of broad things then keep their history. Behind a thin thing that moves, the background must
    rest: what it leaves there is found by its motion over the background.

    Args:
        vectors: (h, w) motion, whose two floats are one word; changed where the background is.
        buffer: (h, w) depth buffer, 1 at the background.
    """
    height, width = buffer.shape
    nearest = np.ones(-(-width // _TILE) * _TILE, np.float32)  # of each column; 1 beyond the last
    count = np.zeros(nearest.size, np.int32)  # of samples of surfaces in each column
    first = np.arange(0, width, _TILE)
    for top in range(0, height, _TILE):
        depth, motion = buffer[top : top + _TILE], vectors[top : top + _TILE]
        background = depth == 1.0
        if background.any():
            np.min(depth, axis=0, out=nearest[:width])
            column = first + nearest.reshape(-1, _TILE).argmin(axis=1)
            row = depth[:, column].argmin(axis=0)
            np.sum(~background, axis=0, out=count[:width])
            is_broad = count.reshape(-1, _TILE).sum(axis=1) > _THIN
            found = np.where(is_broad, motion[row, column], np.uint64(0))
            np.copyto(motion, found.repeat(_TILE)[:width], where=background)


def _array(matrix: Any) -> Matrix:
    return np.array([[matrix.GetElement(row, column) for column in range(4)] for row in range(4)])
