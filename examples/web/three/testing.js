/** Functions for measurements of the page of three.js: `window.threeDemo`, where its address has ?test. */

import { HalfFloatType, NoToneMapping, RenderTarget } from "three/webgpu";
import { readTexture } from "../page/readback.js";
import { base64, meanOf } from "../page/testing.js";

const STEP = 1 / 60, FIRST_TIME = 1;

export class ThreeTesting {
  /** @param {Record<string, any>} scene what the page has made */
  constructor({ renderer, pipeline, scene, camera, animate, upscaled, displaySize }) {
    Object.assign(this, { renderer, pipeline, scene, camera, animate, upscaled });
    renderer.toneMapping = NoToneMapping; // images are read as linear light
    pipeline.outputColorTransform = false;
    this.target = new RenderTarget(...displaySize, { type: HalfFloatType });
    this.index = -1;
  }

  /** Compiles, and waits until the node upscales. */
  async ready() {
    this.animate(FIRST_TIME);
    await this.#inFrame(() => this.#draw());
    await this.upscaled.ready;
    this.upscaled.reset?.();
    this.upscaled._historyRenderTarget?.setSize(1, 1); // three.js' nodes have no reset, but begin again at a new size
  }

  /** @returns {Promise<string>} the next image: linear RGBA, float32, as base64 */
  async step() {
    this.animate(FIRST_TIME + STEP * ++this.index);
    await this.#inFrame(() => this.#draw());
    return base64(await this.#read());
  }

  /** @param {number} samples a pixel @returns {Promise<string>} the same frame drawn at display size, as `step` */
  async reference(samples) {
    const { renderer, target, camera, scene } = this, { width, height } = target;
    const mean = await meanOf(samples, async (jitter) => {
      camera.setViewOffset(width, height, ...jitter, width, height);
      await this.#inFrame(() => {
        renderer.setRenderTarget(target);
        renderer.render(scene, camera);
        renderer.setRenderTarget(null);
      });
      return this.#read();
    });
    camera.clearViewOffset();
    return mean;
  }

  /** Changes the size of the image. */
  resize(width, height) {
    this.renderer.setSize(width, height, false);
    this.target.setSize(width, height);
  }

  #draw() {
    this.renderer.setRenderTarget(this.target);
    this.pipeline.render();
    this.renderer.setRenderTarget(null);
  }

  #read() {
    const { backend } = this.renderer;
    return readTexture(backend.device, backend.get(this.target.texture).texture);
  }

  /** Draws within a turn of three's loop, which counts frames for motion. @param {() => void} draw */
  async #inFrame(draw) {
    await new Promise((resolve, reject) => {
      this.renderer.setAnimationLoop(() => {
        this.renderer.setAnimationLoop(null);
        try {
          draw();
          resolve();
        } catch (error) {
          reject(error);
        }
      });
    });
  }
}
