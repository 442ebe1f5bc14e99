"""Run exported SPIR-V with Vulkan alone: a complete host that does not import supersampler.

    pip install vulkan
    supersampler export classifier --target spirv -o out/shaders
    python examples/raw_frames.py plaza out/raw
    python examples/bare_vulkan.py out/shaders out/raw out/images

It reads everything from upscaler.json. Images are raw half floats (height, width, RGBA), linear. It waits for
each frame, and keeps all images in the layout GENERAL: simple, not fast.
"""

import json
import struct
import sys
from pathlib import Path
from typing import Any, NamedTuple

import vulkan as vk

FORMATS = {
    "rgba32float": (vk.VK_FORMAT_R32G32B32A32_SFLOAT, 16), "rgba32uint": (vk.VK_FORMAT_R32G32B32A32_UINT, 16),
    "rgba16float": (vk.VK_FORMAT_R16G16B16A16_SFLOAT, 8), "rg32float": (vk.VK_FORMAT_R32G32_SFLOAT, 8),
    "rg32uint": (vk.VK_FORMAT_R32G32_UINT, 8), "r32uint": (vk.VK_FORMAT_R32_UINT, 4),
    "r32float": (vk.VK_FORMAT_R32_SFLOAT, 4),
}  # fmt: skip
FRAME_FORMATS = {"color": "rgba32float", "depth": "r32float", "motion": "rg32float", "reactive": "r32float"}
KINDS = {
    "uniform": vk.VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER,
    "storage": vk.VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
    "read-only-storage": vk.VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
    "texture": vk.VK_DESCRIPTOR_TYPE_SAMPLED_IMAGE,
    "uint-texture": vk.VK_DESCRIPTOR_TYPE_SAMPLED_IMAGE,
    "storage-texture": vk.VK_DESCRIPTOR_TYPE_STORAGE_IMAGE,
}
GENERAL, COMPUTE = vk.VK_IMAGE_LAYOUT_GENERAL, vk.VK_PIPELINE_BIND_POINT_COMPUTE
MAX_DESCRIPTORS = 64  # of each kind, per pass


class Memory(NamedTuple):
    """A buffer of `bytes`, or an image of `size` with its view."""

    memory: Any
    buffer: Any = None
    bytes: int = 0
    image: Any = None
    view: Any = None
    size: tuple[int, int] = (0, 0)


def main() -> None:
    shaders, frames, output = map(Path, sys.argv[1:])
    output.mkdir(parents=True, exist_ok=True)
    shot = json.loads((frames / "frames.json").read_text())
    gpu = Gpu()
    host = Host(gpu, shaders, shot["display"])
    for index, frame in enumerate(shot["frames"]):
        files = {name: (frames / frame[name]).read_bytes() for name in FRAME_FORMATS if name in frame}
        (output / f"{index:04d}.rgba16f").write_bytes(host.step(frame, files))
    print(f"{len(shot['frames'])} images on {gpu.name}: {output}")


class Gpu:
    """A device with a compute queue, whose commands run immediately."""

    def __init__(self) -> None:
        application = vk.VkApplicationInfo(apiVersion=vk.VK_MAKE_VERSION(1, 3, 0))
        self.instance = vk.vkCreateInstance(vk.VkInstanceCreateInfo(pApplicationInfo=application), None)
        self.physical = vk.vkEnumeratePhysicalDevices(self.instance)[0]
        self.name = vk.vkGetPhysicalDeviceProperties(self.physical).deviceName
        families = vk.vkGetPhysicalDeviceQueueFamilyProperties(self.physical)
        family = next(i for i, one in enumerate(families) if one.queueFlags & vk.VK_QUEUE_COMPUTE_BIT)
        dot = vk.VkPhysicalDeviceVulkan13Features(shaderIntegerDotProduct=True, maintenance4=True)
        features = vk.VkPhysicalDeviceVulkan12Features(pNext=dot, shaderInt8=True)
        queues = [vk.VkDeviceQueueCreateInfo(queueFamilyIndex=family, queueCount=1, pQueuePriorities=[1.0])]
        core = vk.VkPhysicalDeviceFeatures(shaderStorageImageExtendedFormats=True)
        described = vk.VkDeviceCreateInfo(
            pNext=features, pQueueCreateInfos=queues, queueCreateInfoCount=1, pEnabledFeatures=core
        )
        self.device = vk.vkCreateDevice(self.physical, described, None)
        self.queue = vk.vkGetDeviceQueue(self.device, family, 0)
        pool = vk.vkCreateCommandPool(self.device, vk.VkCommandPoolCreateInfo(queueFamilyIndex=family), None)
        allocation = vk.VkCommandBufferAllocateInfo(
            commandPool=pool, level=vk.VK_COMMAND_BUFFER_LEVEL_PRIMARY, commandBufferCount=1
        )
        self.pool, self.commands = pool, vk.vkAllocateCommandBuffers(self.device, allocation)[0]

    def begin(self) -> Any:
        """Return the command buffer, empty."""
        vk.vkResetCommandPool(self.device, self.pool, 0)
        vk.vkBeginCommandBuffer(self.commands, vk.VkCommandBufferBeginInfo())
        return self.commands

    def run(self) -> None:
        """Run the commands, and wait for them."""
        vk.vkEndCommandBuffer(self.commands)
        vk.vkQueueSubmit(self.queue, 1, [vk.VkSubmitInfo(pCommandBuffers=[self.commands])], None)
        vk.vkQueueWaitIdle(self.queue)

    def barrier(self) -> None:
        """Make earlier writes visible to later commands."""
        every = vk.VK_PIPELINE_STAGE_ALL_COMMANDS_BIT
        written, seen = (
            vk.VK_ACCESS_MEMORY_WRITE_BIT,
            vk.VK_ACCESS_MEMORY_READ_BIT | vk.VK_ACCESS_MEMORY_WRITE_BIT,
        )
        memory = [vk.VkMemoryBarrier(srcAccessMask=written, dstAccessMask=seen)]
        vk.vkCmdPipelineBarrier(self.commands, every, every, 0, 1, memory, 0, None, 0, None)

    def buffer(self, size: int, *, mapped: bool = False) -> Memory:
        """Allocate a buffer for any use; `mapped`: the CPU reads and writes it."""
        uses = (
            vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT,
            vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT, vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT,
        )  # fmt: skip
        described = vk.VkBufferCreateInfo(size=size, usage=sum(uses))
        buffer = vk.vkCreateBuffer(self.device, described, None)
        memory = self._memory(vk.vkGetBufferMemoryRequirements(self.device, buffer), mapped=mapped)
        vk.vkBindBufferMemory(self.device, buffer, memory, 0)
        return Memory(memory, buffer=buffer, bytes=size)

    def image(self, size: tuple[int, int], texel: str) -> Memory:
        """Allocate an image that shaders read and write."""
        uses = (
            vk.VK_IMAGE_USAGE_SAMPLED_BIT, vk.VK_IMAGE_USAGE_STORAGE_BIT,
            vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT, vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT,
        )  # fmt: skip
        described = vk.VkImageCreateInfo(
            imageType=vk.VK_IMAGE_TYPE_2D, format=FORMATS[texel][0], extent=vk.VkExtent3D(*size, 1),
            mipLevels=1, arrayLayers=1, samples=vk.VK_SAMPLE_COUNT_1_BIT, tiling=vk.VK_IMAGE_TILING_OPTIMAL,
            usage=sum(uses), initialLayout=vk.VK_IMAGE_LAYOUT_UNDEFINED,
        )  # fmt: skip
        image = vk.vkCreateImage(self.device, described, None)
        memory = self._memory(vk.vkGetImageMemoryRequirements(self.device, image), mapped=False)
        vk.vkBindImageMemory(self.device, image, memory, 0)
        seen = vk.VkImageViewCreateInfo(
            image=image, viewType=vk.VK_IMAGE_VIEW_TYPE_2D, format=FORMATS[texel][0], subresourceRange=RANGE
        )
        return Memory(memory, image=image, view=vk.vkCreateImageView(self.device, seen, None), size=size)

    def _memory(self, needs: Any, *, mapped: bool) -> Any:
        visible = vk.VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | vk.VK_MEMORY_PROPERTY_HOST_COHERENT_BIT
        wanted = visible if mapped else vk.VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT
        known = vk.vkGetPhysicalDeviceMemoryProperties(self.physical)
        kind = next(
            i
            for i in range(known.memoryTypeCount)
            if needs.memoryTypeBits >> i & 1 and known.memoryTypes[i].propertyFlags & wanted == wanted
        )
        described = vk.VkMemoryAllocateInfo(allocationSize=needs.size, memoryTypeIndex=kind)
        return vk.vkAllocateMemory(self.device, described, None)

    def free(self, one: Memory) -> None:
        """Free memory that no command uses."""
        for thing, destroy in (
            (one.view, vk.vkDestroyImageView), (one.image, vk.vkDestroyImage),
            (one.buffer, vk.vkDestroyBuffer), (one.memory, vk.vkFreeMemory),
        ):  # fmt: skip
            if thing is not None:
                destroy(self.device, thing, None)

    def write(self, one: Memory, data: bytes) -> None:
        """Fill a mapped buffer."""
        mapped = vk.vkMapMemory(self.device, one.memory, 0, len(data), 0)
        mapped[:] = data
        vk.vkUnmapMemory(self.device, one.memory)

    def read(self, one: Memory) -> bytes:
        """Return the content of a mapped buffer."""
        data = bytes(vk.vkMapMemory(self.device, one.memory, 0, one.bytes, 0))
        vk.vkUnmapMemory(self.device, one.memory)
        return data


RANGE = vk.VkImageSubresourceRange(vk.VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1)


class Host:
    """Runs the passes, and holds the history of one view."""

    def __init__(self, gpu: Gpu, folder: Path, display: list[int]) -> None:
        self.gpu, self.folder, self.display = gpu, folder, display
        self.about = json.loads((folder / "upscaler.json").read_text())
        self.passes = [(one, *self._compiled(one)) for one in self.about["passes"]]
        self.history: dict[str, Memory] = {}
        self.previous: dict[str, Any] | None = None

    def step(self, frame: dict[str, Any], files: dict[str, bytes]) -> bytes:
        """Upscale a frame, and return the image."""
        gpu, held = self.gpu, list[Memory]()  # freed at the end
        commands = gpu.begin()
        if frame["reset"] or self.previous is None:
            held += self.history.values()
            self.history, self.previous = {}, frame
        before = self.previous["size"]
        if before != frame["size"]:
            outgrown = [after for _, after in self.about["history"]["pairs"] if after in self.history]
            held += [self.history.pop(after) for after in outgrown]
        sizes = bases_of(frame["size"], before, self.display)
        bound: dict[str, Memory] = {}
        for one in self.about["resources"]:
            name, size = one["name"], size_of(one["size"], sizes)
            bound[name] = self.history.get(name) or self._allocated(one, size)
            if one["role"] == "frame" and name.removeprefix("frame_") in files:
                self._upload(commands, bound[name], files[name.removeprefix("frame_")], held)
            elif "file" in one:
                self._upload(commands, bound[name], (self.folder / one["file"]).read_bytes(), held)
            elif one["role"] == "params":
                self._upload(commands, bound[name], self._params(frame, sizes), held)
            elif name not in self.history:
                self._clear(commands, bound[name])
        pool = self._encode(commands, bound, sizes)
        copied = gpu.buffer(8 * self.display[0] * self.display[1], mapped=True)
        vk.vkCmdCopyImageToBuffer(
            commands, bound["image"].image, GENERAL, copied.buffer, 1, [region(bound["image"].size)]
        )
        gpu.barrier()
        gpu.run()
        image = gpu.read(copied)
        vk.vkDestroyDescriptorPool(gpu.device, pool, None)
        self.history = {}
        for history, following in self.about["history"]["pairs"]:
            self.history[history] = bound[following]
            if before == frame["size"]:  # they swap: shaders write only some of the signatures
                self.history[following] = bound[history]
        self.previous = frame
        kept = {id(one) for one in self.history.values()}
        for one in (*held, copied, *(b for b in bound.values() if id(b) not in kept)):
            gpu.free(one)
        return image

    def _encode(self, commands: Any, bound: dict[str, Memory], sizes: dict[str, list[int]]) -> Any:
        kinds = [
            vk.VkDescriptorPoolSize(kind, MAX_DESCRIPTORS * len(self.passes)) for kind in {*KINDS.values()}
        ]
        described = vk.VkDescriptorPoolCreateInfo(maxSets=2 * len(self.passes), pPoolSizes=kinds)
        pool = vk.vkCreateDescriptorPool(self.gpu.device, described, None)
        for one, pipeline, layout, set_layouts in self.passes:
            self.gpu.barrier()
            allocation = vk.VkDescriptorSetAllocateInfo(descriptorPool=pool, pSetLayouts=set_layouts)
            sets = vk.vkAllocateDescriptorSets(self.gpu.device, allocation)
            writes = [self._write(sets[b["group"]], b, bound[b["resource"]]) for b in one["bindings"]]
            vk.vkUpdateDescriptorSets(self.gpu.device, len(writes), writes, 0, None)
            vk.vkCmdBindPipeline(commands, COMPUTE, pipeline)
            vk.vkCmdBindDescriptorSets(commands, COMPUTE, layout, 0, len(sets), sets, 0, None)
            covered = zip(size_of(one["covers"], sizes), one["tile"], strict=True)
            vk.vkCmdDispatch(commands, *(-(-extent // side) for extent, side in covered), 1)
        self.gpu.barrier()
        return pool

    def _write(self, descriptors: Any, binding: dict[str, Any], memory: Memory) -> Any:
        given: dict[str, Any] = {"pBufferInfo": [vk.VkDescriptorBufferInfo(memory.buffer, 0, memory.bytes)]}
        if memory.image is not None:
            given = {"pImageInfo": [vk.VkDescriptorImageInfo(None, memory.view, GENERAL)]}
        return vk.VkWriteDescriptorSet(
            dstSet=descriptors, dstBinding=binding["binding"], descriptorCount=1,
            descriptorType=KINDS[binding["kind"]], **given,
        )  # fmt: skip

    def _params(self, frame: dict[str, Any], sizes: dict[str, list[int]]) -> bytes:
        values = {**sizes, "jitter": frame["jitter"], "exposure": [frame["exposure"] or 0.0]}
        values |= {"writes_aux": [0.0], "adds_samples": [1.0], "pre_exposure": [1.0], "skips": [1.0]}
        values["has_reactive"] = [0.0]  # no mask: frame_reactive is not read
        params = bytearray(self.about["params"]["bytes"])
        for field in self.about["params"]["fields"]:
            struct.pack_into(f"<{field['count']}f", params, field["offset"], *values[field["name"]])
        return bytes(params)

    def _allocated(self, one: dict[str, Any], size: list[int]) -> Memory:
        if one["kind"] == "texture":
            texel = one.get("format") or FRAME_FORMATS[one["name"].removeprefix("frame_")]
            image = self.gpu.image((size[0], size[1]), texel)
            change = vk.VkImageMemoryBarrier(
                srcAccessMask=0, dstAccessMask=vk.VK_ACCESS_MEMORY_WRITE_BIT, newLayout=GENERAL,
                oldLayout=vk.VK_IMAGE_LAYOUT_UNDEFINED, image=image.image, subresourceRange=RANGE,
            )  # fmt: skip
            every = vk.VK_PIPELINE_STAGE_ALL_COMMANDS_BIT
            vk.vkCmdPipelineBarrier(self.gpu.commands, every, every, 0, 0, None, 0, None, 1, [change])
            return image
        return self.gpu.buffer(max(-(-one["bytes"] * size[0] * size[1] // 4) * 4, 16))

    def _clear(self, commands: Any, memory: Memory) -> None:
        if memory.image is None:
            vk.vkCmdFillBuffer(commands, memory.buffer, 0, memory.bytes, 0)
        else:
            zeros = vk.VkClearColorValue(uint32=[0, 0, 0, 0])
            vk.vkCmdClearColorImage(commands, memory.image, GENERAL, zeros, 1, [RANGE])

    def _upload(self, commands: Any, memory: Memory, data: bytes, held: list[Memory]) -> None:
        held.append(self.gpu.buffer(len(data), mapped=True))
        self.gpu.write(held[-1], data)
        if memory.image is None:
            vk.vkCmdCopyBuffer(
                commands, held[-1].buffer, memory.buffer, 1, [vk.VkBufferCopy(0, 0, len(data))]
            )
        else:
            regions = [region(memory.size)]
            vk.vkCmdCopyBufferToImage(commands, held[-1].buffer, memory.image, GENERAL, 1, regions)

    def _compiled(self, one: dict[str, Any]) -> tuple[Any, Any, list[Any]]:
        device, code = self.gpu.device, (self.folder / one["file"]).read_bytes()
        set_layouts = []
        for group in range(1 + max(b["group"] for b in one["bindings"])):
            bindings = [
                vk.VkDescriptorSetLayoutBinding(
                    binding=b["binding"], descriptorType=KINDS[b["kind"]], descriptorCount=1,
                    stageFlags=vk.VK_SHADER_STAGE_COMPUTE_BIT,
                )
                for b in one["bindings"]
                if b["group"] == group
            ]  # fmt: skip
            described = vk.VkDescriptorSetLayoutCreateInfo(pBindings=bindings)
            set_layouts.append(vk.vkCreateDescriptorSetLayout(device, described, None))
        layout = vk.vkCreatePipelineLayout(
            device, vk.VkPipelineLayoutCreateInfo(pSetLayouts=set_layouts), None
        )
        module = vk.vkCreateShaderModule(
            device, vk.VkShaderModuleCreateInfo(codeSize=len(code), pCode=code), None
        )
        stage = vk.VkPipelineShaderStageCreateInfo(
            stage=vk.VK_SHADER_STAGE_COMPUTE_BIT, module=module, pName=one["entry_point"]
        )
        described = vk.VkComputePipelineCreateInfo(stage=stage, layout=layout)
        return vk.vkCreateComputePipelines(device, None, 1, [described], None)[0], layout, set_layouts


def bases_of(render: list[int], previous: list[int], display: list[int]) -> dict[str, list[int]]:
    """Return the base sizes of the rules in upscaler.json."""
    bases = {"one": [1, 1], "render": render, "previous": previous, "display": display}
    for name, (width, height) in (("signatures", render), ("previous_signatures", previous)):
        phases = 9 * display[0] * display[1] // (width * height) + 2
        bases[name] = [-(-width // 4), -(-height // 4) * phases]
    return bases


def size_of(rule: dict[str, Any], sizes: dict[str, list[int]]) -> list[int]:
    """Return a size by its rule."""
    pairs = zip(sizes[rule["of"]], rule["multiply"], strict=True)
    return [-(-extent // rule["divide"]) * factor for extent, factor in pairs]


def region(size: tuple[int, int]) -> Any:
    """Return the region of a whole image with packed rows."""
    layers = vk.VkImageSubresourceLayers(vk.VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1)
    return vk.VkBufferImageCopy(
        imageSubresource=layers, imageOffset=vk.VkOffset3D(0, 0, 0), imageExtent=vk.VkExtent3D(*size, 1)
    )


if __name__ == "__main__":
    main()
