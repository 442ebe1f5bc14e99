"""glTF 2.0 files as scenes.

>>> model = GltfScene("chair.glb")
>>> model.instances(time=0.5, time_before=0.5 - 1 / 30, transform=np.eye(4))  # a tuple of `Instance`
"""

from supersampler_model.data.gltf.animation import Clip
from supersampler_model.data.gltf.errors import GltfError
from supersampler_model.data.gltf.scene import GltfScene

__all__ = ["Clip", "GltfError", "GltfScene"]
