/**
 * Checks of the promises of supersampler.js beyond images, in Node with Dawn. Writes {promise: true, or a description of the failure} as JSON.
 *
 *   node webgpu_checks.mjs SHADERS NODE_MODULES
 */

import { readFile } from "node:fs/promises";
import { createServer } from "node:http";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { Upscaler, UpscalerError } from "../../examples/web/supersampler.js";

const [shaders, modules] = process.argv.slice(2);
const { create, globals } = await import(pathToFileURL(resolve(modules, "webgpu/index.js")));
Object.assign(globalThis, globals);
const gpu = create([]);
const adapter = await gpu.requestAdapter();
const timed = adapter.features.has("timestamp-query");
const device = await adapter.requestDevice({ requiredFeatures: timed ? ["timestamp-query"] : [] });
const found = {};
const errors = [];
device.addEventListener("uncapturederror", ({ error }) => errors.push(error.message));

const RENDER = [20, 12];
const DISPLAY = [40, 24];
const from = (name) => readFile(join(shaders, name));
const load = (source = from, displaySize = DISPLAY) => Upscaler.load(device, source, { displaySize });

/** A texture; in its upper left, float32 values that differ from pixel to pixel. */
function filled(format, channels, size, seed, room) {
  const usage = GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST;
  const texture = device.createTexture({ size: room, format, usage });
  const values = Float32Array.from(
    { length: channels * size[0] * size[1] },
    (_, i) => ((i * 7919 * seed) % 101) / 101,
  );
  device.queue.writeTexture({ texture }, values, { bytesPerRow: 4 * channels * size[0] }, size);
  return texture;
}

/** A frame that stands still, in textures of `room`. */
function frame(seed, size = RENDER, room = size) {
  const motion = device.createTexture({
    size: room,
    format: "rg32float",
    usage: GPUTextureUsage.TEXTURE_BINDING,
  });
  return {
    color: filled("rgba32float", 4, size, seed, room),
    depth: filled("r32float", 1, size, 1, room),
    motion,
  };
}

const image = (
  size = DISPLAY,
  format = "rgba16float",
  usage = GPUTextureUsage.STORAGE_BINDING | GPUTextureUsage.COPY_SRC,
) => device.createTexture({ size, format, usage });

/** Steps into one encoder, or each submitted by itself; returns the last image's bytes. */
async function steps(upscaler, list, { together = false, output = image() } = {}) {
  let encoder = device.createCommandEncoder();
  for (const { images, ...options } of list) {
    upscaler.encode(encoder, images, output, options);
    if (!together) {
      device.queue.submit([encoder.finish()]);
      encoder = device.createCommandEncoder();
    }
  }
  const copy = device.createBuffer({
    size: 512 * DISPLAY[1],
    usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ,
  });
  encoder.copyTextureToBuffer({ texture: output }, { buffer: copy, bytesPerRow: 512 }, DISPLAY);
  device.queue.submit([encoder.finish()]);
  await copy.mapAsync(GPUMapMode.READ);
  return Buffer.from(copy.getMappedRange().slice()).toString("base64");
}

/** Whether a call throws an UpscalerError with this text. */
async function refuses(call, text) {
  try {
    await call();
  } catch (error) {
    return (
      (error instanceof UpscalerError && error.message.includes(text)) || `${error.name}: ${error.message}`
    );
  }
  return "nothing was thrown";
}

const list = [1, 2, 3].map((seed) => ({
  images: frame(seed),
  jitter: [0.1 * seed, -0.1 * seed],
  exposure: 1,
}));
const apart = await steps(await load(), list);
found["steps in one encoder run in order"] = apart === (await steps(await load(), list, { together: true }));

const usage = GPUTextureUsage.STORAGE_BINDING | GPUTextureUsage.COPY_SRC;
const mips = device.createTexture({ size: DISPLAY, format: "rgba16float", usage, mipLevelCount: 2 });
found["an output may have mips"] = apart === (await steps(await load(), list, { output: mips }));

const again = await load();
await steps(again, list);
again.reset();
found["reset() begins again"] = apart === (await steps(again, list));
found["reset: true begins again"] =
  apart === (await steps(again, [{ ...list[0], reset: true }, list[1], list[2]]));
found["a history counts"] = apart !== (await steps(again, list));

const twice = [2 * DISPLAY[0], 2 * DISPLAY[1]];
const larger = (one) => ({ ...one, images: frame(1, DISPLAY) });
again.resize(twice);
await steps(again, list.map(larger), { output: image(twice) });
again.resize(DISPLAY);
found["resize() to another size and back begins again"] = apart === (await steps(again, list));
found["resize() to a size that is none"] = await refuses(() => again.resize([40]), "displaySize is [40]");
again.reset();
found["a refused resize() leaves the size"] = apart === (await steps(again, list));

/** The list with a mask of one value in each frame. */
const masked = (value) =>
  list.map((step) => {
    const mask = new Float32Array(RENDER[0] * RENDER[1]).fill(value);
    const usage = GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST;
    const reactive = device.createTexture({ size: RENDER, format: "r32float", usage });
    device.queue.writeTexture({ texture: reactive }, mask, { bytesPerRow: 4 * RENDER[0] }, RENDER);
    return { ...step, images: { ...step.images, reactive } };
  });
found["a mask of zeros changes no bit"] = apart === (await steps(await load(), masked(0)));
found["a full mask leaves this frame alone"] =
  (await steps(await load(), masked(1))) === (await steps(await load(), [list[2]]));
found["a mask counts"] = apart !== (await steps(await load(), masked(0.5)));
const preExposed = list.map((step) => ({ ...step, preExposure: 2 }));
found["pre-exposure is divided out"] = apart !== (await steps(await load(), preExposed));
for (const preExposure of [0, -1, NaN, Infinity, "2x"]) {
  found[`a pre-exposure of ${preExposure}`] = await refuses(
    () => steps(again, [{ ...list[0], preExposure }]),
    "what the renderer has multiplied the colour by",
  );
}

const sizes = [
  [20, 12],
  [23, 14],
  [15, 9],
  [20, 12],
];
const changing = (room) =>
  sizes.map((size, i) => ({
    images: frame(i + 1, size, room ?? size),
    jitter: [0, 0.1 * i],
    exposure: 1,
    ...(room ? { renderSize: size } : {}),
  }));
found["a part of larger textures is a frame"] =
  (await steps(await load(), changing())) === (await steps(await load(), changing([40, 30])));

const zBuffer = device.createTexture({
  size: RENDER,
  format: "depth32float",
  usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.RENDER_ATTACHMENT,
});
const clearing = device.createCommandEncoder();
const depthStencilAttachment = {
  view: zBuffer.createView(),
  depthLoadOp: "clear",
  depthStoreOp: "store",
  depthClearValue: 0.25,
};
clearing.beginRenderPass({ colorAttachments: [], depthStencilAttachment }).end();
device.queue.submit([clearing.finish()]);
const flat = device.createTexture({
  size: RENDER,
  format: "r32float",
  usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST,
});
device.queue.writeTexture(
  { texture: flat },
  new Float32Array(RENDER[0] * RENDER[1]).fill(0.25),
  { bytesPerRow: 4 * RENDER[0] },
  RENDER,
);
const withDepth = (depth) => list.map((one) => ({ ...one, images: { ...one.images, depth } }));
found["a z-buffer is a depth"] =
  (await steps(await load(), withDepth(zBuffer))) === (await steps(await load(), withDepth(flat)));

if (timed) {
  const querySet = device.createQuerySet({ type: "timestamp", count: 2 });
  const resolved = device.createBuffer({
    size: 16,
    usage: GPUBufferUsage.QUERY_RESOLVE | GPUBufferUsage.COPY_SRC,
  });
  const read = device.createBuffer({ size: 16, usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ });
  const timestamps = { querySet, beginningOfPassWriteIndex: 0, endOfPassWriteIndex: 1 };
  await steps(await load(), [{ ...list[0], timestamps }]);
  const resolving = device.createCommandEncoder();
  resolving.resolveQuerySet(querySet, 0, 2, resolved, 0);
  resolving.copyBufferToBuffer(resolved, 0, read, 0, 16);
  device.queue.submit([resolving.finish()]);
  await read.mapAsync(GPUMapMode.READ);
  const [began, ended] = new BigUint64Array(read.getMappedRange());
  found["timestamps are written"] = began < ended;
}

const server = createServer(async (request, response) => {
  const file = request.url.match(/^\/some\/path\/([\w.]+)$/)?.[1];
  response.writeHead(file ? 200 : 404).end(file ? await from(file) : "");
});
await new Promise((listening) => server.listen(0, "127.0.0.1", listening));
const address = `http://127.0.0.1:${server.address().port}/some/path`;
found["a folder has an address"] = apart === (await steps(await load(address), list));
found["an address may be a URL"] = apart === (await steps(await load(new URL(`${address}/`)), list));
found["an address without a folder"] = await refuses(() => load(`${address}/other`), "HTTP 404");
server.close();

const good = await load();
const encoder = device.createCommandEncoder();
const encode = (images, output, options) => () =>
  good.encode(encoder, images, output, { jitter: [0, 0], ...options });
const wrong = device.createTexture({
  size: RENDER,
  format: "rgba8uint",
  usage: GPUTextureUsage.TEXTURE_BINDING,
});
const unsigned = device.createTexture({
  size: RENDER,
  format: "rgba8unorm",
  usage: GPUTextureUsage.TEXTURE_BINDING,
});
const [{ images }] = list;
found["jitter in other units"] = await refuses(
  encode(images, image(), { jitter: [3, 0] }),
  "jitter is [3,0]; want",
);
found["a missing image"] = await refuses(
  encode({ ...images, motion: undefined }, image()),
  "frame.motion is undefined",
);
found["a misspelled image"] = await refuses(
  encode({ ...images, reactve: wrong }, image()),
  "frame.reactve is a name that is not known; want one of color, depth, motion, reactive",
);
found["a misspelled option"] = await refuses(
  encode(images, image(), { preexposure: 2 }),
  "options.preexposure is a name that is not known; want one of jitter",
);
found["a format without floats"] = await refuses(
  encode({ ...images, color: wrong }, image()),
  "frame.color is rgba8uint 20x12",
);
found["motion in a format within [0, 1]"] = await refuses(
  encode({ ...images, motion: unsigned }, image()),
  "frame.motion is rgba8unorm 20x12",
);
found["an image of another size"] = await refuses(
  encode({ ...images, depth: filled("r32float", 1, [10, 6], 1, [10, 6]) }, image()),
  "20x12, as color",
);
found["an output of another size"] = await refuses(encode(images, image([41, 24])), "want rgba16float 40x24");
found["an output that is not stored"] = await refuses(
  encode(images, image(DISPLAY, "rgba16float", 1)),
  "STORAGE_BINDING",
);
const layered = { size: [...RENDER, 2], format: "rgba16float", usage: GPUTextureUsage.TEXTURE_BINDING };
found["an image of layers"] = await refuses(
  encode({ ...images, color: device.createTexture(layered) }, image()),
  "1 sample, 2 layers; want rgba16float",
);
found["an output of layers"] = await refuses(encode(images, image([...DISPLAY, 2])), "1 sample, 2 layers; want");
found["a ratio beyond the method's"] = await refuses(
  encode(frame(1, [5, 3]), image()),
  "5x3 for a display of 40x24",
);
found["an exposure that is none"] = await refuses(
  encode(images, image(), { exposure: -1 }),
  "exposure is -1",
);
const aovs = [filled("rgba32float", 4, RENDER, 1, RENDER)];
found["AOVs that the folder does not blend"] = await refuses(
  encode({ ...images, aovs }, image()),
  "frame.aovs is 1 textures; want 0",
);
found["outputs of AOVs that the folder does not blend"] = await refuses(
  encode(images, image(), { aovs: [image()] }),
  "options.aovs is 1 textures; want 0",
);
found["a size that is none"] = await refuses(() => load(from, [0, 10]), "displaySize is [0,10]");
found["a missing file"] = await refuses(() => load(async () => ({ ok: false, status: 404 })), "HTTP 404");
found["another file"] = await refuses(() => load(async () => "<html>"), "no JSON");
const patched = (patch) => async (name) =>
  name === "upscaler.json" ? JSON.stringify({ ...JSON.parse(await from(name)), ...patch }) : from(name);
found["another version"] = await refuses(() => load(patched({ version: 1 })), "version 3");
found["another target"] = await refuses(() => load(patched({ target: "hlsl" })), "--target wgsl");
const described = (await load()).info;
const requires = { ...described.requires, limits: { maxComputeWorkgroupSizeX: 1 << 20 } };
found["a device that lacks a limit"] = await refuses(
  () => load(patched({ requires })),
  "want maxComputeWorkgroupSizeX",
);
const name = device.adapterInfo.description;
const broken = async (file) => (file.endsWith(".wgsl") ? "fn main( {" : from(file));
found["a shader that does not compile, with the adapter's name"] = await refuses(
  () => load(broken),
  `refused by ${name}`,
);
good.destroy();
found["use after destroy()"] = await refuses(encode(images, image()), "destroyed");
await device.queue.onSubmittedWorkDone();
found["no errors of the device"] = errors.length === 0 || errors;
process.stdout.write(JSON.stringify(found));
process.exit(0);
