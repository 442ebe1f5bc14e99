/**
 * Draws the scene: into colour, depth and motion for the upscaler, or into colour alone.
 * @typedef {import("./matrix.js").Matrix} Matrix
 * @typedef {import("./matrix.js").Vector} Vector
 */

import { VERTEX_FLOATS } from "./geometry.js";
import { lookAt, multiply, parallel, perspective, product, reflectionAtZ, unit } from "./matrix.js";
import { FOV_Y, MIRROR_Z, NEAR, SUN, SURFACES, cameraAt, lightsAt, makeThings } from "./world.js";

const THING_FLOATS = 40, VIEW_FLOATS = 100, SHADOW_SIZE = 2048;
const Z_FORMAT = "depth32float", COLOR_FORMAT = "rgba16float";
const REFLECTION = reflectionAtZ(MIRROR_Z);

/**
 * The state of the scene at one frame.
 * @typedef {object} Moment
 * @property {number} time of what moves, in seconds
 * @property {number} cameraTime
 */

/**
 * Colour, depth, motion of one size, and what drawing them needs.
 * Made by `SceneRenderer.makeView`.
 * @typedef {object} View
 * @property {[number, number]} size width and height, pixels
 * @property {GPUTexture} color rgba16float
 * @property {GPUTexture | undefined} depth r32float; undefined where only colour is drawn
 * @property {GPUTexture | undefined} motion rg16float
 * @property {GPUTexture[]} textures all
 * @property {GPUTexture} z @property {GPUTexture} reflected
 * @property {GPUBuffer} main @property {GPUBuffer} mirror
 * @property {GPUBindGroup} mainGroup @property {GPUBindGroup} mirrorGroup
 */

export class SceneRenderer {
  /**
   * Compiles the shaders and uploads the meshes.
   * @param {GPUDevice} device @returns {Promise<SceneRenderer>}
   */
  static async make(device) {
    const url = new URL("scene.wgsl", import.meta.url);
    const answer = await fetch(url);
    if (!answer.ok) throw new Error(`${url}: ${answer.status} ${answer.statusText}`);
    return new SceneRenderer(device, await answer.text());
  }

  /** @param {GPUDevice} device @param {string} code of scene.wgsl */
  constructor(device, code) {
    this.device = device;
    this.things = makeThings();
    this.#uploadMeshes();
    this.thingBuffer = device.createBuffer({ size: 4 * THING_FLOATS * this.things.length, usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST });
    this.shadowMap = device.createTexture({ size: [SHADOW_SIZE, SHADOW_SIZE], format: Z_FORMAT, usage: GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.TEXTURE_BINDING });
    this.shadowSampler = device.createSampler({ compare: "less-equal", magFilter: "linear", minFilter: "linear" });
    this.noReflection = device.createTexture({ size: [1, 1], format: COLOR_FORMAT, usage: GPUTextureUsage.TEXTURE_BINDING });
    this.#makePipelines(device.createShaderModule({ label: "scene.wgsl", code }));
    this.shadowView = this.#viewBuffer();
    this.shadowGroup = device.createBindGroup({
      layout: this.shadowLayout,
      entries: [{ binding: 0, resource: { buffer: this.shadowView } }, { binding: 1, resource: { buffer: this.thingBuffer } }],
    });
  }

  #uploadMeshes() {
    const vertices = [], indices = [];
    this.draws = this.things.map(({ mesh }) => {
      const draw = { count: mesh.indices.length, first: indices.length, base: vertices.length / VERTEX_FLOATS };
      for (const value of mesh.vertices) vertices.push(value);
      for (const index of mesh.indices) indices.push(index);
      return draw;
    });
    this.vertices = this.#filled(new Float32Array(vertices), GPUBufferUsage.VERTEX);
    this.indices = this.#filled(new Uint32Array(indices), GPUBufferUsage.INDEX);
  }

  /** @param {Float32Array | Uint32Array} data @param {number} usage @returns {GPUBuffer} */
  #filled(data, usage) {
    const buffer = this.device.createBuffer({ size: data.byteLength, usage: usage | GPUBufferUsage.COPY_DST });
    this.device.queue.writeBuffer(buffer, 0, data);
    return buffer;
  }

  #viewBuffer() {
    return this.device.createBuffer({ size: 4 * VIEW_FLOATS, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
  }

  /** @param {GPUShaderModule} module */
  #makePipelines(module) {
    const { device } = this, both = GPUShaderStage.VERTEX | GPUShaderStage.FRAGMENT;
    const view = { binding: 0, visibility: both, buffer: { type: "uniform" } };
    const things = { binding: 1, visibility: both, buffer: { type: "read-only-storage" } };
    this.shadowLayout = device.createBindGroupLayout({ entries: [view, things] });
    this.layout = device.createBindGroupLayout({
      entries: [
        view, things,
        { binding: 2, visibility: GPUShaderStage.FRAGMENT, texture: { sampleType: "depth" } },
        { binding: 3, visibility: GPUShaderStage.FRAGMENT, sampler: { type: "comparison" } },
        { binding: 4, visibility: GPUShaderStage.FRAGMENT, texture: { sampleType: "unfilterable-float" } },
      ],
    });
    const buffers = [{
      arrayStride: 4 * VERTEX_FLOATS,
      attributes: [
        { shaderLocation: 0, offset: 0, format: "float32x3" },
        { shaderLocation: 1, offset: 12, format: "float32x3" },
        { shaderLocation: 2, offset: 24, format: "float32x2" },
      ],
    }];
    const one = [{ format: COLOR_FORMAT }], all = [{ format: COLOR_FORMAT }, { format: "rg16float" }, { format: "r32float" }];
    const pipeline = (vertex, fragment, targets) => device.createRenderPipeline({
      label: fragment ?? vertex,
      layout: device.createPipelineLayout({ bindGroupLayouts: [fragment ? this.layout : this.shadowLayout] }),
      vertex: { module, entryPoint: vertex, buffers: vertex === "sky_vertex" ? [] : buffers },
      fragment: fragment && { module, entryPoint: fragment, targets },
      depthStencil: {
        format: Z_FORMAT, depthWriteEnabled: vertex !== "sky_vertex",
        depthCompare: vertex === "sky_vertex" ? "equal" : fragment ? "greater" : "less",
      },
    });
    this.shadowPipeline = pipeline("shadow_vertex");
    this.thingPixels = pipeline("thing_vertex", "thing_pixel", all);
    this.thingColors = pipeline("thing_vertex", "thing_color", one);
    this.skyPixels = pipeline("sky_vertex", "sky_pixel", all);
    this.skyColors = pipeline("sky_vertex", "sky_color", one);
  }

  /**
   * @param {[number, number]} size width and height @param {boolean} colorOnly without depth and motion
   * @returns {View}
   */
  makeView(size, colorOnly) {
    const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_SRC;
    const texture = (format) => this.device.createTexture({ size, format, usage });
    const color = texture(COLOR_FORMAT), reflected = texture(COLOR_FORMAT), z = texture(Z_FORMAT);
    const depth = colorOnly ? undefined : texture("r32float"), motion = colorOnly ? undefined : texture("rg16float");
    const main = this.#viewBuffer(), mirror = this.#viewBuffer();
    const group = (buffer, seen) => this.device.createBindGroup({
      layout: this.layout,
      entries: [
        { binding: 0, resource: { buffer } }, { binding: 1, resource: { buffer: this.thingBuffer } },
        { binding: 2, resource: this.shadowMap.createView() }, { binding: 3, resource: this.shadowSampler },
        { binding: 4, resource: seen.createView() },
      ],
    });
    return {
      size, color, depth, motion, z, reflected, main, mirror,
      textures: [color, reflected, z, depth, motion].filter(Boolean),
      mainGroup: group(main, reflected), mirrorGroup: group(mirror, this.noReflection),
    };
  }

  /** @param {View} view */
  destroyView(view) {
    for (const texture of view.textures) texture.destroy();
    view.main.destroy();
    view.mirror.destroy();
  }

  /**
   * Places all things, and draws the shadow map. Once a frame, before `draw`.
   * @param {GPUCommandEncoder} encoder @param {Moment} now @param {Moment} previous the previous frame's
   */
  place(encoder, now, previous) {
    const data = new Float32Array(THING_FLOATS * this.things.length);
    this.things.forEach(({ place, color, gloss, surface }, i) => {
      data.set(place(now.time), THING_FLOATS * i);
      data.set(place(previous.time), THING_FLOATS * i + 16);
      data.set([...color, gloss ?? 0, surface], THING_FLOATS * i + 32);
    });
    this.device.queue.writeBuffer(this.thingBuffer, 0, data);
    this.now = now;
    this.previous = previous;
    const view = new Float32Array(VIEW_FLOATS);
    view.set(sunClip(), 32);
    this.device.queue.writeBuffer(this.shadowView, 0, view);
    const pass = encoder.beginRenderPass({
      colorAttachments: [],
      depthStencilAttachment: { view: this.shadowMap.createView(), depthClearValue: 1, depthLoadOp: "clear", depthStoreOp: "store" },
    });
    pass.setPipeline(this.shadowPipeline);
    pass.setBindGroup(0, this.shadowGroup);
    this.#drawThings(pass, (thing) => thing.surface !== SURFACES.light);
    pass.end();
  }

  /**
   * Draws one view of what `place` has placed.
   * @param {GPUCommandEncoder} encoder @param {View} view
   * @param {object} [options]
   * @param {[number, number]} [options.jitter] of the samples: pixel centre + jitter, pixels
   * @param {number} [options.filterWidth] of textures, in pixels; render over display size is the usual mip bias
   * @param {GPURenderPassTimestampWrites} [options.begin] for the first pass
   * @param {GPURenderPassTimestampWrites} [options.end] for the last pass
   */
  draw(encoder, view, { jitter = [0, 0], filterWidth = 1, begin, end } = {}) {
    const clips = [this.now, this.previous].map((moment) => clipAt(moment, view.size));
    const write = (buffer, isMirror) => this.device.queue.writeBuffer(
      buffer, 0, viewData(this.now, clips, view.size, jitter, filterWidth, isMirror));
    write(view.mirror, true);
    write(view.main, false);
    const mirrorPass = encoder.beginRenderPass({ ...attachments([view.reflected], view.z), timestampWrites: begin });
    this.#drawAll(mirrorPass, view.mirrorGroup, this.thingColors, this.skyColors, (thing) => thing.surface !== SURFACES.mirror);
    const targets = view.depth ? [view.color, view.motion, view.depth] : [view.color];
    const mainPass = encoder.beginRenderPass({ ...attachments(targets, view.z), timestampWrites: end });
    const [things, sky] = view.depth ? [this.thingPixels, this.skyPixels] : [this.thingColors, this.skyColors];
    this.#drawAll(mainPass, view.mainGroup, things, sky, () => true);
  }

  #drawAll(pass, group, things, sky, isDrawn) {
    pass.setBindGroup(0, group);
    pass.setPipeline(things);
    this.#drawThings(pass, isDrawn);
    pass.setPipeline(sky);
    pass.draw(3);
    pass.end();
  }

  #drawThings(pass, isDrawn) {
    pass.setVertexBuffer(0, this.vertices);
    pass.setIndexBuffer(this.indices, "uint32");
    this.draws.forEach((draw, i) => {
      if (isDrawn(this.things[i])) pass.drawIndexed(draw.count, 1, draw.first, draw.base, i);
    });
  }
}

/** @param {GPUTexture[]} targets @param {GPUTexture} z @returns {GPURenderPassDescriptor} */
function attachments(targets, z) {
  return {
    colorAttachments: targets.map((target) => ({ view: target.createView(), loadOp: "clear", storeOp: "store", clearValue: [0, 0, 0, 0] })),
    depthStencilAttachment: { view: z.createView(), depthClearValue: 0, depthLoadOp: "clear", depthStoreOp: "discard" },
  };
}

/** @param {Moment} moment @param {[number, number]} size @returns {Matrix} world to clip coordinates */
function clipAt(moment, [width, height]) {
  return multiply(perspective(FOV_Y, width / height, NEAR), cameraAt(moment.cameraTime).view);
}

/** @returns {Matrix} world to the coordinates of the shadow map */
function sunClip() {
  const sun = unit(SUN), middle = [0, 1, -2.5];
  return multiply(parallel(8.5, 24), lookAt(middle.map((value, axis) => value + 12 * sun[axis]), middle));
}

/** Contents of `View` in scene.wgsl. @returns {Float32Array} */
function viewData(now, [clip, previousClip], [width, height], jitter, filterWidth, isMirror) {
  const data = new Float32Array(VIEW_FLOATS), { eye, view } = cameraAt(now.cameraTime);
  const flip = isMirror ? -1 : 1, tangent = Math.tan(FOV_Y / 2);
  data.set(isMirror ? product(clip, REFLECTION) : clip, 0);
  data.set(isMirror ? product(previousClip, REFLECTION) : previousClip, 16);
  data.set(sunClip(), 32);
  data.set([eye[0], eye[1], isMirror ? 2 * MIRROR_Z - eye[2] : eye[2], filterWidth], 48);
  data.set([...jitter, width, height], 52);
  data.set([MIRROR_Z, isMirror ? 1 : 0], 56);
  const row = (i, scale) => [scale * view[i], scale * view[4 + i], flip * scale * view[8 + i]];
  data.set(row(0, (tangent * width) / height), 60);
  data.set(row(1, tangent), 64);
  data.set(row(2, -1), 68);
  data.set(unit(SUN), 72);
  lightsAt(now.time).forEach((light, i) => {
    data.set(light.position, 76 + 8 * i);
    data.set(light.color, 80 + 8 * i);
  });
  return data;
}
