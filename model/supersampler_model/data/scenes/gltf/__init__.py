"""glTF 2.0 files as scenes.

>>> model = GltfScene("chair.glb")
>>> model.instances(time=0.5, time_before=0.5 - 1 / 30, transform=np.eye(4))  # a tuple of `Instance`
>>> compose("my/files", seed=7).scene(0)  # a stage and props of a folder, lit, with a camera
"""

from supersampler_model.data.scenes.gltf.compose import Composition, compose
from supersampler_model.data.scenes.gltf.document import GltfError
from supersampler_model.data.scenes.gltf.model import GltfScene

__all__ = ["Composition", "GltfError", "GltfScene", "compose"]
