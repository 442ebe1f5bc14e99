/** Frames of a shot folder, uploaded one by one. */

import { HALF_ONE, floatsOf } from "./half.js";

const KEY = 0.18, DARKEST = 1e-4, ADAPTATION = 0.1, MAX_HALF = 65504; // as supersampler.io.display has them

export class ShotSource {
  /**
   * @param {GPUDevice} device @param {import("./shot_folder.js").ShotFolder} shot
   * @param {string} kind of the source, as the page's controls call it
   */
  constructor(device, shot, kind) {
    this.device = device;
    this.shot = shot;
    this.kind = kind;
    this.displaySize = shot.displaySize;
    this.interval = 1 / (shot.frameRate ?? 30);
    this.truthName = "reference";
    this.index = -1;
    this.meter = new ExposureMeter();
    /** @type {Map<string, GPUTexture>} */ this.textures = new Map();
    this.waiting = shot.frame(0);
    this.waiting.catch(() => {}); // `advance` reports it
  }

  /** Reads the next frame; after the last one the first. */
  async advance() {
    this.frame = await this.waiting;
    this.index = (this.index + 1) % this.shot.length;
    this.waiting = this.shot.frame((this.index + 1) % this.shot.length);
    this.waiting.catch(() => {});
    this.exposure = this.meter.read(this.frame);
  }

  /**
   * Uploads the frame.
   * @returns {import("./live_source.js").SourceFrame}
   */
  encode() {
    const { color, depth, motion, size, jitter, reset } = this.frame;
    return {
      color: this.#upload("color", size, color, 4), motion: this.#upload("motion", size, motion, 2),
      depth: this.#upload("depth", size, [asFloat(depth)], 1),
      size, jitter, reset, exposure: this.exposure,
    };
  }

  /** @returns {Promise<GPUTexture | null>} the frame's reference, if it has one */
  async truth() {
    const reference = await this.frame.reference();
    return reference && this.#upload("reference", reference.size, reference.planes, 4);
  }

  /**
   * @param {string} name @param {[number, number]} size @param {import("./exr.js").Plane[]} planes
   * @param {1 | 2 | 4} channels of the texture; the fourth is 1
   * @returns {GPUTexture}
   */
  #upload(name, size, planes, channels) {
    const isHalf = planes.every(({ type }) => type === "half");
    const Pixels = isHalf ? Uint16Array : Float32Array;
    const pixels = new Pixels(channels * size[0] * size[1]).fill(isHalf ? HALF_ONE : 1);
    planes.forEach((plane, channel) => {
      const { values } = isHalf ? plane : asFloat(plane);
      for (let i = 0; i < values.length; i++) pixels[channels * i + channel] = values[i];
    });
    const format = `${{ 1: "r", 2: "rg", 4: "rgba" }[channels]}${isHalf ? 16 : 32}float`;
    const texture = this.#texture(name, size, format);
    this.device.queue.writeTexture({ texture }, pixels, { bytesPerRow: channels * Pixels.BYTES_PER_ELEMENT * size[0] }, size);
    return texture;
  }

  #texture(name, size, format) {
    const before = this.textures.get(name);
    if (before && before.width === size[0] && before.height === size[1] && before.format === format) return before;
    before?.destroy();
    const usage = GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST | GPUTextureUsage.COPY_SRC;
    const texture = this.device.createTexture({ label: name, size, format, usage });
    this.textures.set(name, texture);
    return texture;
  }

  /** Frees its textures. */
  destroy() {
    for (const texture of this.textures.values()) texture.destroy();
  }
}

/** @param {number} value @returns {number} within [0, 65504]; NaN stays */
const withinHalf = (value) => Math.min(Math.max(value, 0), MAX_HALF);

/** Exposure of frames: what the shot states, else the log-average luminance as middle grey, followed slowly. */
export class ExposureMeter {
  /** @param {import("./shot_folder.js").ShotFrame} frame @returns {number} */
  read({ color, exposure, reset }) {
    if (exposure !== null) return exposure;
    const [red, green, blue] = color.map((plane) => asFloat(plane).values);
    let sum = 0, count = 0;
    for (let i = 0; i < red.length; i++) {
      const luminance = 0.2126 * withinHalf(red[i]) + 0.7152 * withinHalf(green[i]) + 0.0722 * withinHalf(blue[i]);
      if (Number.isNaN(luminance)) continue;
      sum += Math.log(Math.max(luminance, DARKEST));
      count++;
    }
    const target = KEY / (count ? Math.exp(sum / count) : DARKEST);
    this.followed = reset || !this.followed ? target : this.followed ** (1 - ADAPTATION) * target ** ADAPTATION;
    return this.followed;
  }
}

/** @param {import("./exr.js").Plane} plane @returns {{ type: "float", values: Float32Array }} */
export const asFloat = (plane) => (plane.type === "float" ? plane : { type: "float", values: floatsOf(plane.values) });
