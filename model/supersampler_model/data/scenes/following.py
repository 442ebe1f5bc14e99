"""Motion to the next frame: a scene that is rendered with the next one in place of the previous one."""

from dataclasses import replace

from supersampler_model.data.errors import DataError
from supersampler_model.data.scenes.scene import Scene


def towards(scene: Scene, following: Scene) -> Scene:
    """Return a scene whose motion vectors lead to the next frame: next minus current, `Frame.motion_next`.

    Args:
        scene: of a frame.
        following: of the next frame: the same instances, elsewhere.

    Raises:
        DataError: the two have different instances, as on two sides of a cut.
    """
    if [one.mesh for one in scene.instances] != [one.mesh for one in following.instances]:
        raise DataError("the next frame has other instances: no motion leads across a cut")
    instances = tuple(
        replace(now, model_before=after.model, palette_before=after.palette)
        for now, after in zip(scene.instances, following.instances, strict=True)
    )
    return replace(scene, instances=instances, camera_before=following.camera)
