"""Materials of a glTF file: metallic and roughness, normals, occlusion, emission, holes."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from OpenImageIO import ImageInput, ImageSpec, geterror

from supersampler.io.files import write_bytes
from supersampler_model.data.scenes.gltf.document import Document, Json, MalformedError, at
from supersampler_model.data.scenes.scene import Color, Material, Pixels, Texture

LARGEST = 16384  # texels a side; no GL takes more
_SUFFIXES = {b"\x89PNG": ".png", b"\xff\xd8\xff": ".jpg"}
_BLACK = 16  # of 255
_TRANSFORM = "KHR_texture_transform"


class Coordinates(NamedTuple):
    """Texture coordinates of a vertex: uv = scale * TEXCOORD_<of> + offset."""

    of: int = 0
    offset: tuple[float, float] = (0.0, 0.0)
    scale: tuple[float, float] = (1.0, 1.0)


class SurfaceMaterial(NamedTuple):
    """A material, None if it is fully transparent, and the coordinates of its textures, if any."""

    material: Material | None
    coordinates: Coordinates | None


class Materials:
    """The materials of a file. Shared images and textures are loaded once.

    BLEND, which the renderer does not support, becomes MASK at 0.5. Black occlusion maps, which some
    exporters write if there is none, are ignored.
    """

    def __init__(self, document: Document) -> None:
        self._document = document
        self._surfaces: dict[int | None, SurfaceMaterial] = {}
        self._images: dict[int, Pixels] = {}
        self._textures: dict[tuple[Any, ...], Texture] = {}

    def surface(self, index: int | None) -> SurfaceMaterial:
        """Return material `index`; None is the default material of glTF."""
        if index not in self._surfaces:
            if index is None:
                self._surfaces[index] = self._surface({})
            else:
                content = self._document.item("materials", index)
                with at(self._document.name("materials", index)):
                    self._surfaces[index] = self._surface(content)
        return self._surfaces[index]

    def _surface(self, content: Json) -> SurfaceMaterial:
        pbr, emission = content.get("pbrMetallicRoughness", {}), _emission(content)
        textures = {
            "baseColorTexture": pbr.get("baseColorTexture"),
            "normalTexture": content.get("normalTexture"),
            "metallicRoughnessTexture": pbr.get("metallicRoughnessTexture"),
            "emissiveTexture": content.get("emissiveTexture") if any(emission) else None,
        }
        base, normal, metallic, emissive = textures.values()
        coordinates, occlusion = _shared(textures), content.get("occlusionTexture")
        if occlusion is not None:
            coordinates = coordinates or _coordinates(occlusion)
            if _coordinates(occlusion) != coordinates:
                occlusion = None  # with other coordinates it does not fit into the ORM texture
        color = self._plain(base, srgb=True) if base else None
        factor = [float(value) for value in pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))]
        cutoff, visible = _cutoff(content, factor[3], color)
        if not visible:
            return SurfaceMaterial(None, coordinates)
        material = Material(
            base_color=(factor[0], factor[1], factor[2]),
            roughness=_number(pbr, "roughnessFactor", 1.0),
            metallic=_number(pbr, "metallicFactor", 1.0),
            emissive=emission,
            base_color_texture=color,
            normal_texture=self._normals(normal) if normal else None,
            orm_texture=self._orm(metallic, occlusion),
            emissive_texture=self._plain(emissive, srgb=True) if emissive else None,
            alpha_cutoff=cutoff,
            double_sided=bool(content.get("doubleSided", False)),
        )
        return SurfaceMaterial(material, coordinates)

    def _plain(self, info: Json, *, srgb: bool) -> Texture:
        source = self._source(info)
        return self._texture(("plain", source, srgb), lambda: self._image(source), srgb=srgb)

    def _normals(self, info: Json) -> Texture:
        source, scale = self._source(info), _number(info, "scale", 1.0)
        if scale == 1.0:
            return self._plain(info, srgb=False)

        def scaled() -> Pixels:
            normals = self._image(source)[..., :3] / 127.5 - 1.0
            normals = normals * (scale, scale, 1.0)
            normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-6)
            return np.asarray((127.5 * normals + 127.5).round(), np.uint8)

        return self._texture(("normals", source, scale), scaled, srgb=False)

    def _orm(self, metallic: Json | None, occlusion: Json | None) -> Texture | None:
        """Return occlusion, roughness and metallic in one texture, of the size of the last two."""
        if metallic is None and occlusion is None:
            return None
        sources = tuple(None if info is None else self._source(info) for info in (metallic, occlusion))
        strength = 0.0 if occlusion is None else _number(occlusion, "strength", 1.0)

        def combined() -> Pixels:
            rest, shade = (None if source is None else self._image(source) for source in sources)
            height, width = next(image.shape[:2] for image in (rest, shade) if image is not None)
            orm = np.full((height, width, 3), 255, np.uint8)
            if rest is not None:
                orm[..., 1:] = rest[..., 1:3]
            if shade is not None and np.percentile(shade[..., 0], 99) >= _BLACK:
                h, w = shade.shape[:2]
                red = shade[np.arange(height) * h // height][:, np.arange(width) * w // width, 0]
                orm[..., 0] = (255.0 - np.clip(strength, 0.0, 1.0) * (255.0 - red)).round()
            return orm

        return self._texture(("orm", *sources, strength), combined, srgb=False)

    def _texture(self, key: tuple[Any, ...], pixels: Callable[[], Pixels], *, srgb: bool) -> Texture:
        if key not in self._textures:
            self._textures[key] = Texture(pixels=pixels(), srgb=srgb)
        return self._textures[key]

    def _source(self, info: Json) -> int:
        """Return the index of the image that a texture shows."""
        texture = self._document.item("textures", info["index"])
        if "source" not in texture:
            kinds = ", ".join(texture.get("extensions", {})) or "nothing else"
            raise MalformedError(f"texture {info['index']} has no PNG or JPEG image ({kinds})")
        self._document.item("images", texture["source"])
        return int(texture["source"])

    def _image(self, index: int) -> Pixels:
        """Return (h, w, 3 or 4) uint8; the fourth channel is unassociated opacity."""
        if index not in self._images:
            document = self._document
            image = document.item("images", index)
            with at(document.name("images", index)):
                inside = "bufferView" in image
                data = document.view(image["bufferView"])[0] if inside else document.load(image["uri"])
                self._images[index] = _decoded(document, data)
        return self._images[index]


def _decoded(document: Document, data: bytes) -> Pixels:
    """Return the pixels of a PNG or JPEG file; grey becomes colour, 16 bits become 8."""
    suffix = next((suffix for magic, suffix in _SUFFIXES.items() if data.startswith(magic)), None)
    if suffix is None:
        raise MalformedError(f"it is neither PNG nor JPEG (it begins with {data[:4]!r})")
    config = ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    with tempfile.TemporaryDirectory() as folder:  # OpenImageIO's Python interface only reads files
        path = Path(folder) / f"image{suffix}"
        write_bytes(path, data)
        source = ImageInput.open(str(path), config)
        if source is None:
            raise MalformedError(f"it is damaged ({geterror().strip()})")
        spec = source.spec()
        if max(spec.width, spec.height) > LARGEST:
            raise MalformedError(f"it is {spec.width} x {spec.height}; want at most {LARGEST} a side")
        document.claim("images", spec.width * spec.height * spec.nchannels)
        read = source.read_image(0, 0, 0, spec.nchannels, "uint8")
        if read is None:
            raise MalformedError(f"it is damaged ({source.geterror().strip()})")
    pixels = np.asarray(read, np.uint8)
    if pixels.shape[2] < 3:
        pixels = np.concatenate([pixels[..., :1]] * 3 + [pixels[..., 1:]], axis=-1)
    return np.ascontiguousarray(pixels[..., :4])


def _cutoff(content: Json, opacity: float, color: Texture | None) -> tuple[float | None, bool]:
    """Return the alpha cutoff of the texture, None without one, and whether any surface is visible."""
    mode = content.get("alphaMode", "OPAQUE")
    if mode not in ("OPAQUE", "MASK", "BLEND"):
        raise MalformedError(f"its alphaMode is {mode!r}; want OPAQUE, MASK or BLEND")
    if mode == "OPAQUE":
        return None, True
    cutoff = 0.5 if mode == "BLEND" else _number(content, "alphaCutoff", 0.5)
    if opacity < cutoff:
        return None, False
    if color is None or color.pixels.shape[2] != 4 or cutoff <= 0.0:
        return None, True
    cutoff /= opacity  # the renderer compares the texture's opacity alone
    return cutoff, bool(color.pixels[..., 3].max() >= 255.0 * cutoff)


def _emission(content: Json) -> Color:
    extensions = content.get("extensions", {})
    strength = _number(extensions.get("KHR_materials_emissive_strength", {}), "emissiveStrength", 1.0)
    red, green, blue = (strength * float(value) for value in content.get("emissiveFactor", (0.0, 0.0, 0.0)))
    return red, green, blue


def _shared(infos: dict[str, Json | None]) -> Coordinates | None:
    """Return the coordinates that all these textures must share, as a mesh has one set."""
    used = {name: _coordinates(info) for name, info in infos.items() if info is not None}
    if len(set(used.values())) > 1:
        kinds = "; ".join(f"{name}: {tuple(coordinates)}" for name, coordinates in used.items())
        raise MalformedError(f"its textures are placed in different ways ({kinds}); only one is supported")
    return next(iter(used.values()), None)


def _coordinates(info: Json) -> Coordinates:
    transform = info.get("extensions", {}).get(_TRANSFORM, {})
    if transform.get("rotation", 0.0) != 0.0:
        raise MalformedError(f"{_TRANSFORM} rotates a texture, which is not supported")
    of = transform.get("texCoord", info.get("texCoord", 0))
    u, v = (float(value) for value in transform.get("offset", (0.0, 0.0)))
    across, down = (float(value) for value in transform.get("scale", (1.0, 1.0)))
    return Coordinates(of, (u, v), (across, down))


def _number(item: Json, name: str, default: float) -> float:
    value = float(item.get(name, default))
    if not np.isfinite(value):
        raise MalformedError(f"its {name} is {value}; want a finite number")
    return value
