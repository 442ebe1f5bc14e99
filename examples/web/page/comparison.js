/**
 * One source of frames, the upscaler, and the two views on the stage.
 * @typedef {import("./live_source.js").LiveSource} LiveSource
 * @typedef {import("./shot_source.js").ShotSource} ShotSource
 */

import models from "../models/index.js";
import { Upscaler } from "../supersampler.js";
import { Presenter } from "./presenter.js";
import { StageTimer } from "./timing.js";

export class Comparison {
  /** @param {import("./gpu.js").Gpu} gpu @param {import("./stage.js").Stage} stage @returns {Promise<Comparison>} */
  static async make(gpu, stage) {
    return new Comparison(gpu, stage, await Presenter.make(gpu.device, stage.canvas));
  }

  /** @param {import("./gpu.js").Gpu} gpu @param {import("./stage.js").Stage} stage @param {Presenter} presenter */
  constructor(gpu, stage, presenter) {
    this.gpu = gpu;
    this.device = gpu.device;
    this.stage = stage;
    this.presenter = presenter;
    this.timer = gpu.hasTimestamps ? new StageTimer(gpu.device) : null;
    /** @type {import("./timing.js").StageTimes | null} */ this.times = null;
    /** @type {LiveSource | ShotSource} */ this.source = undefined;
    /** @type {string} */ this.method = undefined;
    /** @type {Upscaler} */ this.upscaler = undefined;
    /** @type {GPUTexture} the upscaled image */ this.output = undefined;
    /** @type {import("./live_source.js").SourceFrame} */ this.frame = undefined;
    this.inFlight = Promise.resolve();
  }

  /**
   * Shows frames of another source, or by another method.
   * @param {LiveSource | ShotSource} source
   * @param {string} method one of models/
   */
  async set(source, method) {
    const { default: files } = await models[method]();
    const upscaler = await Upscaler.load(this.device, (name) => files[name], { displaySize: source.displaySize });
    this.upscaler?.destroy();
    this.output?.destroy();
    if (this.source !== source) this.source?.destroy();
    this.upscaler = upscaler;
    this.source = source;
    this.method = method;
    this.frame = undefined;
    const usage = GPUTextureUsage.STORAGE_BINDING | GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_SRC;
    this.output = this.device.createTexture({ size: source.displaySize, format: "rgba16float", usage });
    this.stage.setSize(source.displaySize);
    this.stage.nameTruth(source.truthName);
  }

  /** Draws and upscales the next frame, and shows it. @param {number} seconds since the previous one */
  async step(seconds) {
    await this.source.advance(seconds);
    await this.inFlight; // of the frame before the previous one: the GPU never has more than two to do
    this.inFlight = this.device.queue.onSubmittedWorkDone();
    const encoder = this.device.createCommandEncoder(), writes = this.timer?.writes;
    const frame = this.source.encode(encoder, writes);
    const { color, depth, motion, size, jitter, exposure, reset } = frame;
    this.upscaler.encode(encoder, { color, depth, motion }, this.output, {
      renderSize: size, jitter, exposure, reset, timestamps: writes?.upscaling,
    });
    if (this.stage.shows("truth")) frame.truth = await this.source.truth(encoder);
    this.frame = frame;
    this.presenter.encode(encoder, frame, this.output, this.stage.shown, writes?.views);
    this.timer?.encode(encoder);
    this.device.queue.submit([encoder.finish()]);
    this.timer?.read().then((times) => {
      this.times = times ?? this.times;
    }, () => {}); // the device is lost
  }

  /** Shows the same frame again, after a change of the stage. */
  async present() {
    const { frame } = this;
    if (!frame) return;
    const encoder = this.device.createCommandEncoder();
    if (this.stage.shows("truth") && frame.truth === undefined) frame.truth = await this.source.truth(encoder);
    this.presenter.encode(encoder, frame, this.output, this.stage.shown);
    this.device.queue.submit([encoder.finish()]);
  }
}
