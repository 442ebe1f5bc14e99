/**
 * Upscale raw frames in Node, with Dawn (npm's `webgpu`) and ../web/supersampler.js.
 *
 *   npm ci
 *   node run.mjs SHADERS FRAMES OUTPUT
 *
 * SHADERS: folder that `supersampler export METHOD --target wgsl` wrote. FRAMES: folder that ../raw_frames.py wrote.
 * OUTPUT: folder for images, raw half floats (height, width, RGBA); AOVs beside them.
 */

import { mkdir, readFile, writeFile } from "node:fs/promises";
import { join } from "node:path";
import { create, globals } from "webgpu";
import { Upscaler, UpscalerError } from "../web/supersampler.js";
import { parsedJson } from "../web/supersampler_folder.js";

Object.assign(globalThis, globals);
const FORMATS = { 1: "r32float", 2: "rg32float", 4: "rgba32float" }; // by channels
const CHANNELS = { depth: 1, reactive: 1, gbuffer_display_depth: 1, motion: 2 }; // all others have four
const FRAMES = 1 << 20;
const ROW = 256; // rows of a copied texture begin at multiples of this many bytes

const [shaders, frames, output] = process.argv.slice(2);
if (!output) {
  console.error("usage: node run.mjs SHADERS FRAMES OUTPUT");
  process.exit(2);
}
const gpu = create([]); // it lives as long as its adapters and devices are in use
const adapter = await gpu.requestAdapter();
if (!adapter) {
  console.error("no adapter: install a Vulkan driver; VK_ICD_FILENAMES chooses one");
  process.exit(3);
}
const device = await adapter.requestDevice();
device.addEventListener("uncapturederror", ({ error }) => {
  console.error(error.message);
  process.exit(1);
});

const shot = parsedJson(await readFile(join(frames, "frames.json"), "utf8"), (place, got, want) => {
  return new UpscalerError(`frames.json: ${place}`, got, want, "examples/raw_frames.py writes it.");
});
const side = (one) => one.whole(1, device.limits.maxTextureDimension2D);
const [width, height] = shot.at("display").pair(side);
const list = shot
  .at("frames")
  .items(1, FRAMES)
  .map((frame) => ({ field: frame, ...frame.object(), size: frame.at("size").pair(side) }));
const upscaler = await Upscaler.load(device, (name) => readFile(join(shaders, name)), {
  displaySize: [width, height],
});
const inputs = upscaler.info.inputs.map((one) => one.name);
const blended = inputs.filter((name) => name.startsWith("aovs"));
const [image, ...aovs] = ["image", ...blended].map((label) =>
  device.createTexture({
    label,
    size: [width, height],
    format: "rgba16float",
    usage: GPUTextureUsage.STORAGE_BINDING | GPUTextureUsage.COPY_SRC,
  }),
);
const pitch = Math.ceil((8 * width) / ROW) * ROW;
const copy = device.createBuffer({
  size: pitch * height,
  usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ,
});
const textures = {};

await mkdir(output, { recursive: true });
for (const [index, frame] of list.entries()) {
  const given = {};
  for (const name of inputs) {
    if (name !== "reactive" || "reactive" in frame) given[name] = await uploaded(name, frame);
  }
  const encoder = device.createCommandEncoder();
  given.aovs = blended.map((name) => given[name]);
  upscaler.encode(encoder, given, image, {
    jitter: frame.jitter,
    exposure: frame.exposure,
    preExposure: frame.field.at("pre_exposure").number(2 ** -24, 2 ** 24),
    reset: frame.reset,
    aovs,
  });
  device.queue.submit([encoder.finish()]);
  const name = join(output, String(index).padStart(4, "0"));
  await writeFile(`${name}.rgba16f`, await pixels(image));
  for (const [i, texture] of aovs.entries()) await writeFile(`${name}.aovs${i}.rgba16f`, await pixels(texture));
}
const { description, device: name } = adapter.info;
console.log(`${list.length} images on ${description || name}: ${output}`);
upscaler.destroy();
process.exit(0); // Dawn's event loop would keep Node

/** Write an image of a frame to its texture, and return that. */
async function uploaded(name, frame) {
  const [w, h] = name.startsWith("gbuffer_display") ? [width, height] : frame.size;
  const channels = CHANNELS[name] ?? 4;
  if (textures[name]?.width !== w || textures[name]?.height !== h) {
    const usage = GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST;
    textures[name] = device.createTexture({ size: [w, h], format: FORMATS[channels], usage });
  }
  const file = frame.field.at(name).file();
  const data = await readFile(join(frames, file));
  const wanted = 4 * channels * w * h;
  if (data.length !== wanted) {
    throw new UpscalerError(file, `${data.length} bytes`, wanted, "Write the frames again.");
  }
  device.queue.writeTexture({ texture: textures[name] }, data, { bytesPerRow: 4 * channels * w }, [w, h]);
  return textures[name];
}

/** Return an image without the padding of rows. */
async function pixels(texture) {
  const encoder = device.createCommandEncoder();
  encoder.copyTextureToBuffer({ texture }, { buffer: copy, bytesPerRow: pitch }, [width, height]);
  device.queue.submit([encoder.finish()]);
  await copy.mapAsync(GPUMapMode.READ);
  const rows = new Uint8Array(copy.getMappedRange());
  const packed = new Uint8Array(8 * width * height);
  for (let y = 0; y < height; y++) packed.set(rows.subarray(y * pitch, y * pitch + 8 * width), y * 8 * width);
  copy.unmap();
  return packed;
}
