/** Functions for the tests of the page of three.js: `window.threeDemo`, after the last frame. */

import { HalfFloatType, RenderTarget } from "three/webgpu";
import { haltonJitter } from "../jitter.js";
import { readTexture } from "../page/readback.js";
import { base64 } from "../page/testing.js";

export class ThreeTesting {
  constructor(upscaling, scene, camera) {
    this.upscaling = upscaling;
    this.scene = scene;
    this.camera = camera;
  }

  /** @returns {Promise<string>} the linear RGBA of the upscaled image, float32, as base64 */
  async readOurs() {
    return base64(await readTexture(this.upscaling.device, this.upscaling.output));
  }

  /** @param {number} samples a pixel @returns {Promise<string>} the same frame drawn at display size, as `readOurs` */
  async readReference(samples) {
    const { renderer, output, device } = this.upscaling, { width, height } = output, { camera, scene } = this;
    const target = new RenderTarget(width, height, { type: HalfFloatType });
    let mean;
    for (let index = 0; index < samples; index++) {
      const [x, y] = samples === 1 ? [0, 0] : haltonJitter(index, Math.sqrt(samples / 8));
      camera.setViewOffset(width, height, x, y, width, height);
      renderer.setRenderTarget(target);
      renderer.render(scene, camera);
      renderer.setRenderTarget(null);
      const pixels = await readTexture(device, renderer.backend.get(target.texture).texture);
      mean ??= new Float32Array(pixels.length);
      for (let i = 0; i < mean.length; i++) mean[i] += pixels[i] / samples;
    }
    camera.clearViewOffset();
    target.dispose();
    return base64(mean);
  }
}
