/** Functions for the tests of this page: `window.supersamplerDemo`, where its address has ?test. */

import { haltonJitter } from "../jitter.js";
import { readTexture } from "./readback.js";

export class Testing {
  /**
   * @param {import("./comparison.js").Comparison} comparison
   * @param {() => Promise<void>} settled resolves when changes of the controls are on the screen
   */
  constructor(comparison, settled) {
    this.comparison = comparison;
    this.settled = settled;
  }

  /** @param {number} count of frames @param {number} seconds between them */
  async step(count, seconds = 1 / 60) {
    for (let i = 0; i < count; i++) await this.comparison.step(seconds);
    await this.comparison.device.queue.onSubmittedWorkDone();
  }

  /** @returns {object} what the page shows */
  get state() {
    const { frame, method, source } = this.comparison;
    return { method, size: frame.size, displaySize: source.displaySize, jitter: frame.jitter, exposure: frame.exposure };
  }

  /** @param {"input" | "ours"} view @returns {Promise<string>} the linear RGBA of its pixels, float32, as base64 */
  async read(view) {
    const { device, frame, output } = this.comparison;
    return base64(await readTexture(device, view === "ours" ? output : frame.color));
  }

  /** @param {number} samples a pixel @returns {Promise<string>} the live frame at display size, as `read` */
  readReference(samples) {
    const { device, source } = this.comparison, { renderer, native } = source;
    return meanOf(samples, (jitter) => {
      const encoder = device.createCommandEncoder();
      renderer.draw(encoder, native, { jitter, filterWidth: 0.5 });
      device.queue.submit([encoder.finish()]);
      return readTexture(device, native.color);
    });
  }
}

/** @param {number} samples @param {(jitter: [number, number]) => Promise<Float32Array>} draw one @returns {Promise<string>} their mean, as `base64` */
export async function meanOf(samples, draw) {
  let mean;
  for (let index = 0; index < samples; index++) {
    const pixels = await draw(haltonJitter(index, Math.sqrt(samples / 8)));
    mean ??= new Float32Array(pixels.length);
    for (let i = 0; i < mean.length; i++) mean[i] += pixels[i] / samples;
  }
  return base64(mean);
}

/** @param {Float32Array} values @returns {string} */
export function base64(values) {
  const bytes = new Uint8Array(values.buffer);
  let text = "";
  for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
  return btoa(text);
}
