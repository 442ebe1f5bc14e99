/**
 * Temporal supersampling on any WebGPU device, from a folder that `supersampler export METHOD --target wgsl` wrote.
 *
 *   const upscaler = await Upscaler.load(device, "models/classifier/", { displaySize: [1920, 1080] });
 *   upscaler.encode(encoder, { color, depth, motion }, output, { jitter: [x, y], reset: isFirst });
 *   device.queue.submit([encoder.finish()]);
 *
 * No dependencies, no build step. Runs in browsers and in Node with npm's `webgpu` (Dawn).
 */

import {
  INPUTS,
  UpscalerError,
  aovsOf,
  basesOf,
  bytesOf,
  checkDevice,
  checkMemory,
  compiled,
  fitsRatio,
  readInfo,
  reader,
  shown,
  sizeOf,
} from "./supersampler_folder.js";

export { haltonJitter } from "./jitter.js";
export { UpscalerError };

const MAX_GROUPS = 8; // bind groups that a pass keeps: frames and histories alternate
const STEPS = 1024; // whose params are in one buffer, until their encoders are submitted
const FRAME = [...INPUTS, "aovs"];
const LOAD_OPTIONS = ["displaySize"];
const OPTIONS = [
  "jitter",
  "renderSize",
  "exposure",
  "preExposure",
  "addsSamples",
  "reset",
  "aovs",
  "timestamps",
];
const EXPOSURES = [2 ** -24, 2 ** 24];
const BUFFER = { MAP_WRITE: 2, COPY_SRC: 4, COPY_DST: 8, UNIFORM: 64, STORAGE: 128 }; // GPUBufferUsage
const TEXTURE = { COPY_SRC: 1, TEXTURE_BINDING: 4, STORAGE_BINDING: 8, RENDER_ATTACHMENT: 16 }; // GPUTextureUsage
const losses = new WeakMap(); // of devices; a device outlives the upscalers, which nothing of it must keep

/** Upscales the frames of one view; it holds the view's history. */
export class Upscaler {
  /**
   * Load the shaders and compile them.
   *
   * @param {GPUDevice} device runs the shaders; frames and images are its textures.
   * @param {string|URL|function(string): any} source the folder's URL, or a function that takes the name of a file
   *   and returns a Response, an ArrayBuffer, a typed array or a string, or a promise of one.
   * @param {{displaySize: [number, number]}} options displaySize: (width, height) of the images.
   * @returns {Promise<Upscaler>}
   * @throws {UpscalerError} a file is missing or of another format, the device lacks something, or a shader does
   *   not compile: then the message names the adapter.
   */
  static async load(device, source, options) {
    checkNames("options", options, LOAD_OPTIONS);
    const read = reader(source);
    const info = await readInfo(read);
    checkDevice(device, info);
    const display = checkedDisplay(device, info, options?.displaySize);
    const files = info.resources.filter((one) => one.file);
    const [passes, weights] = await Promise.all([
      Promise.all(info.passes.map((one) => compiled(device, one, read))),
      Promise.all(files.map(async (one) => [one.name, await read(one.file, "bytes", one.bytes)])),
    ]);
    return new Upscaler(device, info, display, passes, new Map(weights));
  }

  /** Use `Upscaler.load`. */
  constructor(device, info, displaySize, passes, weights) {
    this.device = device;
    /** Parsed upscaler.json. */
    this.info = info;
    /** (width, height) of the images. */
    this.displaySize = displaySize;
    this._passes = passes;
    this._aovs = aovsOf(info);
    this._byName = new Map(info.resources.map((one) => [one.name, one]));
    this._memory = new Map(); // by name; of history and next: by name and set, "history_pixels/0"
    this._pairs = info.history.pairs;
    this._current = 0; // the set that holds the history
    this._previous = null; // size of the frame that wrote it; null: no history
    this._dirty = false; // whether the set that holds the history has been written
    this._ids = new WeakMap(); // of textures and buffers, in keys of bind groups
    this._views = new WeakMap();
    this._count = 0;
    this._steps = 0;
    this._destroyed = false;
    if (!losses.has(device)) {
      losses.set(device, null);
      device.lost.then((lost) => losses.set(device, lost));
    }
    for (const [name, bytes] of weights) this._upload(name, bytes);
  }

  /**
   * Encode one step. Submit steps in order, each once; call `reset` after an encoder that is not submitted.
   *
   * @param {GPUCommandEncoder} encoder of the device.
   * @param {import("./supersampler.js").UpscalerFrame} frame textures with TEXTURE_BINDING, of float formats: color
   *   rgba16float or rgba32float, depth r32float (or a z-buffer depth32float, reversed with an infinite far plane),
   *   motion rg16float or rg32float, reactive r8unorm, r16float or r32float; for `gbuffer-fast` gbuffer_normal and
   *   others; aovs, a list, as long as the folder was exported with. `info.inputs` has formats and units. A method that
   *   does not read one takes none; reactive may be missing.
   * @param {GPUTexture} output rgba16float with STORAGE_BINDING, of display size.
   * @param {object} options
   * @param {[number, number]} options.jitter (x, y) in render pixels, in [-0.5, 0.5].
   * @param {[number, number]} [options.renderSize] the part of the frame's textures that was rendered, from the upper
   *   left; all of it if not given.
   * @param {?number} [options.exposure] factor of the colour before the tone curve; not given: measured.
   * @param {number} [options.preExposure] what the renderer has multiplied the colour by; 1 if not given.
   * @param {number} [options.addsSamples] 1 if not given; 0 where the colour was not sampled in this frame; 2 for the
   *   frames of a path tracer.
   * @param {boolean} [options.reset] true on the first frame after a cut.
   * @param {GPUTexture[]} [options.aovs] textures like output, for the blended aovs of the frame.
   * @param {GPUComputePassTimestampWrites} [options.timestamps] of the compute pass.
   * @throws {UpscalerError} an argument is not as described; the history is unchanged.
   */
  encode(encoder, frame, output, options) {
    checkNames("frame", frame, FRAME);
    checkNames("options", options, OPTIONS);
    const { jitter, renderSize, exposure = null, preExposure = 1, addsSamples = 1 } = options ?? {};
    const { reset = false, aovs = [], timestamps } = options ?? {};
    this._checkUsable();
    if (!encoder?.beginComputePass) throw new UpscalerError("encoder", shown(encoder), "a GPUCommandEncoder");
    const offset = checkedJitter(jitter);
    const images = this._checkedFrame(frame, renderSize);
    this._checkCount("options.aovs", aovs);
    const outputs = new Map([["image", output], ...this._aovs.map((name, i) => [name, aovs[i]])]);
    for (const [name, texture] of outputs) checkOutput(name, texture, this.displaySize, images, outputs);
    const factors = {
      exposure: checkedExposure(exposure),
      preExposure: checkedPreExposure(preExposure),
      addsSamples: checkedSamples(addsSamples),
    };
    checkRatio(this.info.ratios, images.size, this.displaySize);
    const before = reset ? null : this._previous;
    const size = basesOf(images.size, before ?? images.size, this.displaySize);
    checkMemory(this.device, this.info, size, "render size", "render");
    if (reset) this.reset();
    const bound = this._allocated(size, images.textures, outputs);
    if (!before && this._dirty) this._clear(encoder);
    this._writeParams(encoder, bound.get("params"), size, offset, {
      ...factors,
      hasReactive: images.textures.has("frame_reactive"),
    });
    const pass = encoder.beginComputePass({ label: "supersampler", timestampWrites: timestamps });
    for (const one of this._passes) {
      pass.setPipeline(one.pipeline);
      one.groups.forEach((_, number) => pass.setBindGroup(number, this._bindGroup(one, number, bound)));
      const [width, height] = sizeOf(one.covers, size);
      pass.dispatchWorkgroups(Math.ceil(width / one.tile[0]), Math.ceil(height / one.tile[1]));
    }
    pass.end();
    this._current = 1 - this._current;
    this._previous = images.size;
    this._dirty = true;
  }

  /** Begin the next frame without a history. */
  reset() {
    this._previous = null;
  }

  /**
   * Change the size of the images, when all encoded steps are submitted. The history is dropped, and its memory freed.
   *
   * @param {[number, number]} displaySize (width, height)
   * @throws {UpscalerError} the device has no textures of this size; the size is as before.
   */
  resize(displaySize) {
    this._checkUsable();
    this.displaySize = checkedDisplay(this.device, this.info, displaySize);
    this._free(([key]) => !["params", "weights"].includes(this._byName.get(key)?.role));
    this._dirty = false;
    this.reset();
  }

  /** Free the memory on the device. Call it when all encoded steps are submitted. */
  destroy() {
    this._free(() => true);
    this._passes = [];
    this._destroyed = true;
  }

  _free(isFreed) {
    for (const [key, { resource }] of [...this._memory].filter(isFreed)) {
      resource.destroy();
      this._memory.delete(key);
    }
  }

  _checkUsable() {
    if (this._destroyed) throw new UpscalerError("upscaler", "destroyed", "one in use", "Load a new one.");
    const lost = losses.get(this.device);
    if (lost) {
      const got = `on a lost device (${lost.message || lost.reason})`;
      throw new UpscalerError("upscaler", got, "a device", "Request a new device and load a new upscaler.");
    }
  }

  /** Return the frame's textures by the names of resources, and the render size. */
  _checkedFrame(frame, renderSize) {
    this._checkCount("frame.aovs", frame?.aovs);
    const textures = new Map();
    for (const { name } of this.info.inputs) {
      const place = this._aovs.indexOf(name);
      const texture = place < 0 ? frame?.[name] : frame.aovs[place];
      if (name === "reactive" && (texture === undefined || texture === null)) continue;
      if (!texture?.createView) throw new UpscalerError(`frame.${name}`, shown(texture), "a GPUTexture");
      const isDepth = texture.format.startsWith("depth32float");
      const isFloat = isDepth ? name.endsWith("depth") : formatOf(name).test(texture.format);
      const isPlain = isFlat(texture) && texture.sampleCount === 1;
      if (!isFloat || !(texture.usage & TEXTURE.TEXTURE_BINDING) || !isPlain) {
        const formats = this.info.inputs.find((one) => one.name === name).formats.join(" or ");
        throw new UpscalerError(`frame.${name}`, textureText(texture), `${formats} of one layer with TEXTURE_BINDING`);
      }
      textures.set(`frame_${name}`, texture);
    }
    const color = frame.color;
    const whole = [color.width, color.height];
    const size = renderSize === undefined ? whole : checkedSize("renderSize", renderSize, Infinity);
    for (const [name, texture] of textures) {
      const ofDisplay = this._byName.get(name).size.of === "display";
      const wanted = ofDisplay ? this.displaySize : size;
      const mayBeLarger = renderSize !== undefined && !ofDisplay;
      const fits = mayBeLarger
        ? texture.width >= wanted[0] && texture.height >= wanted[1]
        : same([texture.width, texture.height], wanted);
      if (!fits) {
        const whose = ofDisplay ? ", as the display" : ", as color";
        const want = mayBeLarger ? `at least ${wanted.join("x")}` : `${wanted.join("x")}${whose}`;
        throw new UpscalerError(name.replace("_", "."), textureText(texture), want);
      }
    }
    return { textures, size };
  }

  /** Throw unless there is a texture for each of the folder's AOVs. */
  _checkCount(name, textures) {
    const count = textures?.length ?? 0;
    if (count !== this._aovs.length) {
      const hint = "`supersampler export METHOD --target wgsl --aovs CHANNELS` sets the number.";
      throw new UpscalerError(name, `${count} textures`, `${this._aovs.length}`, hint);
    }
  }

  /** Return what each resource is bound to, by name; allocates what is missing or too small. */
  _allocated(size, textures, outputs) {
    const given = [["frame_reactive", this._noMask()], ...textures, ...outputs];
    const bound = new Map(given.map(([name, resource]) => [name, { resource }]));
    const sets = { history: this._current, next: 1 - this._current };
    for (const one of this.info.resources) {
      if (bound.has(one.name)) continue;
      const pair = this._pairs.findIndex((names) => names.includes(one.name));
      const key = one.role in sets ? `${pair}/${sets[one.role]}` : one.name;
      bound.set(one.name, this._held(key, one, sizeOf(one.size, size)));
    }
    return bound;
  }

  /** Return the memory of a key, at least of this size in pixels. */
  _held(key, described, [width, height]) {
    const isBuffer = described.kind !== "texture";
    const bytes = isBuffer ? bytesOf(described, width, height) : 0;
    let held = this._memory.get(key);
    const fits = held && (isBuffer ? held.room >= bytes : held.room[0] >= width && held.room[1] >= height);
    if (!fits) {
      // What it replaces may be in an encoder that is not yet submitted: the garbage collector frees it.
      const [across, down] = isBuffer ? [0, 0] : (held?.room ?? [0, 0]);
      const room = isBuffer ? bytes : [Math.max(across, width), Math.max(down, height)];
      const resource = isBuffer ? this._newBuffer(described, bytes) : this._newTexture(described, room);
      held = { resource, room };
      this._memory.set(key, held);
    }
    return { resource: held.resource, bytes };
  }

  /** Return a texture in place of a missing reactive mask, which no shader reads. */
  _noMask() {
    const described = { kind: "texture", name: "no mask", format: "rgba16float", role: "work" };
    return this._held("no mask", described, [1, 1]).resource;
  }

  _newBuffer(described, bytes) {
    const kind = described.kind === "uniform" ? BUFFER.UNIFORM : BUFFER.STORAGE;
    const usage = kind | BUFFER.COPY_SRC | BUFFER.COPY_DST;
    return this.device.createBuffer({ label: described.name, size: bytes, usage });
  }

  _newTexture(described, room) {
    let usage = TEXTURE.TEXTURE_BINDING | TEXTURE.STORAGE_BINDING | TEXTURE.COPY_SRC;
    if (described.role !== "work") usage |= TEXTURE.RENDER_ATTACHMENT; // to clear it
    return this.device.createTexture({ label: described.name, size: room, format: described.format, usage });
  }

  _upload(name, bytes) {
    const described = this._byName.get(name);
    if (bytes.byteLength !== described.bytes) {
      throw new UpscalerError(name, `${bytes.byteLength} bytes`, described.bytes, "Copy the folder again.");
    }
    this.device.queue.writeBuffer(this._held(name, described, [1, 1]).resource, 0, bytes);
  }

  /** Fill the history with zeros, in the order of the encoder. */
  _clear(encoder) {
    this._pairs.forEach((_, pair) => {
      const { resource } = this._memory.get(`${pair}/${this._current}`);
      if (!resource.createView) return encoder.clearBuffer(resource);
      const color = { view: this._view(resource), loadOp: "clear", storeOp: "store", clearValue: [0, 0, 0, 0] };
      encoder.beginRenderPass({ label: "supersampler reset", colorAttachments: [color] }).end();
    });
  }

  /** Write params in the order of the encoder, which may hold several steps. */
  _writeParams(encoder, { resource }, size, jitter, { exposure, preExposure, hasReactive, addsSamples }) {
    const values = {
      render: size.render,
      display: size.display,
      previous: size.previous,
      jitter,
      exposure: [exposure],
      adds_samples: [addsSamples],
      writes_aux: [this._aovs.length ? 1 : 0],
      pre_exposure: [preExposure],
      has_reactive: [hasReactive ? 1 : 0],
      skips: [this._aovs.length ? 0 : 2],
    };
    const { bytes, fields } = this.info.params;
    const written = new Float32Array(bytes / 4);
    for (const { name, offset } of fields) written.set(values[name], offset / 4);
    const place = bytes * (this._steps++ % STEPS);
    if (place === 0 || !this._memory.has("steps")) {
      // The one before may be in an encoder that is not yet submitted: the garbage collector frees it.
      const usage = BUFFER.COPY_SRC | BUFFER.COPY_DST;
      this._memory.set("steps", { resource: this.device.createBuffer({ label: "steps", size: bytes * STEPS, usage }) });
    }
    const steps = this._memory.get("steps").resource;
    this.device.queue.writeBuffer(steps, place, written);
    encoder.copyBufferToBuffer(steps, place, resource, 0, bytes);
  }

  _bindGroup(pass, number, bound) {
    const layout = pass.groups[number];
    const given = layout.bindings.map((one) => bound.get(one.resource));
    const key = `${number}:${given.map(({ resource, bytes }) => `${this._id(resource)}/${bytes ?? 0}`).join()}`;
    let group = pass.bindGroups.get(key);
    pass.bindGroups.delete(key); // to the end: the first one is that used longest ago
    if (!group) {
      const entries = layout.bindings.map((one, i) => {
        const { resource, bytes } = given[i];
        return { binding: one.binding, resource: bytes ? { buffer: resource, size: bytes } : this._view(resource) };
      });
      group = this.device.createBindGroup({ layout: layout.layout, entries });
    }
    pass.bindGroups.set(key, group);
    if (pass.bindGroups.size > MAX_GROUPS) pass.bindGroups.delete(pass.bindGroups.keys().next().value);
    return group;
  }

  _id(resource) {
    if (!this._ids.has(resource)) this._ids.set(resource, ++this._count);
    return this._ids.get(resource);
  }

  _view(texture) {
    if (!this._views.has(texture)) {
      const aspect = texture.format.startsWith("depth") ? "depth-only" : "all";
      this._views.set(texture, texture.createView({ aspect, mipLevelCount: 1 }));
    }
    return this._views.get(texture);
  }
}

function checkedSize(name, size, most) {
  const isSide = (side) => Number.isInteger(side) && side >= 1 && side <= most;
  if (size?.length !== 2 || !isSide(size[0]) || !isSide(size[1])) {
    const want = `[width, height], whole numbers from 1${most === Infinity ? "" : ` to ${most}`}`;
    throw new UpscalerError(name, shown(size), want);
  }
  return [size[0], size[1]];
}

function checkedDisplay(device, info, displaySize) {
  const display = checkedSize("displaySize", displaySize, device.limits.maxTextureDimension2D);
  const least = [1, 1]; // of what depends on frames, which `encode` checks
  const sizes = { ...basesOf(least, least, display), signatures: least, previous_signatures: least };
  checkMemory(device, info, sizes, "displaySize", "display");
  return display;
}

/** Throw where an object has a name that means nothing here: a misspelled one would be ignored. */
function checkNames(place, given, known) {
  const stranger = Object.keys(given ?? {}).find((name) => !known.includes(name));
  if (stranger === undefined) return;
  const names = known.filter((name) => !/^aovs\d/.test(name)).join(", ");
  throw new UpscalerError(`${place}.${stranger}`, "a name that is not known", `one of ${names}`);
}

function checkedJitter(jitter) {
  const good = jitter?.length === 2 && [jitter[0], jitter[1]].every((one) => Math.abs(one) <= 0.5);
  if (!good) {
    const want = "[x, y] in render pixels, in [-0.5, 0.5]";
    throw new UpscalerError("jitter", shown(jitter), want, "Divide offsets in clip space by 2 / render size.");
  }
  return [Math.fround(jitter[0]), Math.fround(jitter[1])];
}

/** Return the factor, or 0 where it is to be measured. */
function checkedExposure(exposure) {
  if (exposure === null || exposure === undefined) return 0;
  if (!(exposure > 0 && Number.isFinite(exposure))) {
    throw new UpscalerError("exposure", shown(exposure), "a number > 0, or null to measure it");
  }
  return exposure >= EXPOSURES[0] && exposure <= EXPOSURES[1] ? exposure : 0;
}

function checkedPreExposure(factor) {
  if (!(factor >= EXPOSURES[0] && factor <= EXPOSURES[1])) {
    const want = "a number in [2^-24, 2^24]: what the renderer has multiplied the colour by";
    throw new UpscalerError("preExposure", shown(factor), want);
  }
  return factor;
}

function checkedSamples(addsSamples) {
  if (![0, 1, 2].includes(addsSamples)) {
    const want = "1; 0 where the colour was not sampled in this frame, or 2 for the frames of a path tracer";
    throw new UpscalerError("addsSamples", shown(addsSamples), want);
  }
  return addsSamples;
}

function checkOutput(resource, output, display, images, outputs) {
  const name = resource === "image" ? "output" : `options.${resource}`;
  const good =
    output?.createView &&
    output.format === "rgba16float" &&
    output.usage & TEXTURE.STORAGE_BINDING &&
    isFlat(output) &&
    same([output.width, output.height], display);
  if (!good) {
    const got = output?.createView ? textureText(output) : shown(output);
    throw new UpscalerError(name, got, `rgba16float ${display.join("x")} of one layer with STORAGE_BINDING`);
  }
  const textures = [...images.textures.values(), ...outputs.values()];
  if (textures.filter((one) => one === output).length > 1) {
    throw new UpscalerError(name, "a texture of the frame or another output", "another texture");
  }
}

/** Throw unless display size over render size is in the method's range. */
function checkRatio([low, high], render, display) {
  if (!fitsRatio([low, high], render, display)) {
    const got = `${render.join("x")} for a display of ${display.join("x")}`;
    throw new UpscalerError("render size", got, `${low} to ${high} times less than the display's`);
  }
}

function same(one, other) {
  return one[0] === other[0] && one[1] === other[1];
}

/** Formats that hold the values of an image: pixels of motion are beyond [-1, 1], and normals have signs. */
function formatOf(name) {
  if (name === "motion") return /^rg(ba)?\d+float$/;
  return name.endsWith("normal") ? /^rgba\d+(float|snorm)$/ : /^r.*(float|norm)|^bgra8unorm/;
}

/** Whether a texture has two dimensions and one layer. */
function isFlat({ dimension = "2d", depthOrArrayLayers = 1 }) {
  return dimension === "2d" && depthOrArrayLayers === 1;
}

function textureText({ format, width, height, usage, sampleCount, depthOrArrayLayers: layers = 1 }) {
  const text = `${format} ${width}x${height}, usage ${usage}, ${sampleCount} sample${sampleCount === 1 ? "" : "s"}`;
  return layers === 1 ? text : `${text}, ${layers} layers`;
}
