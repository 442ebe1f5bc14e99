"""glTF 2.0 files as scenes.

>>> model = GltfScene("chair.glb")
>>> model.instances(time=0.5, time_before=0.5 - 1 / 30, transform=np.eye(4))  # a tuple of `Instance`
>>> Composition(read_folder(Path("my/files")).spec(7, 32)).scene(0)  # stage and props, lit, with a camera
"""

from supersampler_model.data.scenes.gltf.compose import Composition, read_folder
from supersampler_model.data.scenes.gltf.document import GltfError
from supersampler_model.data.scenes.gltf.model import GltfScene

__all__ = ["Composition", "GltfError", "GltfScene", "read_folder"]
