/**
 * Frames of the scene, drawn live.
 * @typedef {import("./timing.js").StageTimer} StageTimer
 *
 * @typedef {object} SourceFrame one frame that a source has encoded
 * @property {GPUTexture} color @property {GPUTexture} depth @property {GPUTexture} motion
 * @property {[number, number]} size width and height of these
 * @property {[number, number]} jitter @property {number} exposure @property {boolean} reset
 * @property {GPUTexture | null} [truth] at display size: native rendering or a reference; undefined if not requested
 */

import { haltonJitter } from "../jitter.js";

const TIME_OF_FIRST_FRAME = 4;

export class LiveSource {
  /**
   * @param {import("../scene/renderer.js").SceneRenderer} renderer
   * @param {[number, number]} displaySize @param {number} ratio display over render size
   */
  constructor(renderer, displaySize, ratio) {
    this.renderer = renderer;
    this.displaySize = displaySize;
    this.interval = 0;
    this.truthName = "native";
    this.native = renderer.makeView(displaySize, true);
    this.moment = { time: TIME_OF_FIRST_FRAME, cameraTime: TIME_OF_FIRST_FRAME };
    this.previous = this.moment;
    this.cameraMoves = true;
    this.index = 0;
    this.setRatio(ratio);
  }

  /** @param {number} ratio display over render size */
  setRatio(ratio) {
    if (this.view) this.renderer.destroyView(this.view);
    this.ratio = ratio;
    this.view = this.renderer.makeView(this.displaySize.map((side) => Math.round(side / ratio)), false);
    this.reset = true;
  }

  /** @param {number} seconds since the previous frame */
  async advance(seconds) {
    this.previous = this.moment;
    const { time, cameraTime } = this.moment;
    this.moment = { time: time + seconds, cameraTime: cameraTime + (this.cameraMoves ? seconds : 0) };
    this.index++;
  }

  /**
   * Draws the frame.
   * @param {GPUCommandEncoder} encoder @param {StageTimer["writes"]} [writes] of the frame's times
   * @returns {SourceFrame}
   */
  encode(encoder, writes) {
    const jitter = haltonJitter(this.index, this.ratio), reset = this.reset;
    this.renderer.place(encoder, this.moment, reset ? this.moment : this.previous);
    this.renderer.draw(encoder, this.view, { jitter, filterWidth: 1 / this.ratio, begin: writes?.rasterBegin, end: writes?.rasterEnd });
    this.reset = false;
    const { color, depth, motion, size } = this.view;
    return { color, depth, motion, size, jitter, exposure: 1, reset };
  }

  /** Draws the frame at display size. @param {GPUCommandEncoder} encoder after `encode` @returns {Promise<GPUTexture>} */
  async truth(encoder) {
    this.renderer.draw(encoder, this.native);
    return this.native.color;
  }

  /** Frees its textures. */
  destroy() {
    this.renderer.destroyView(this.view);
    this.renderer.destroyView(this.native);
  }
}
