/**
 * Upscales what three.js' WebGPURenderer draws, on its own device.
 *
 *   const upscaling = await ThreeUpscaling.make(renderer, { displaySize: [1280, 720], ratio: 2, models: "models/classifier/" });
 *   renderer.setAnimationLoop(() => {
 *     upscaling.render(scene, camera);     // once in a turn of the loop: three.js counts frames for motion by it
 *     quad.render(renderer);               // a QuadMesh that shows upscaling.texture
 *   });
 */

import { DepthTexture, ExternalTexture, FloatType, HalfFloatType, Matrix4, NearestFilter, RenderTarget } from "three/webgpu";
import { mrt, output, velocity } from "three/tsl";
import { haltonJitter } from "../jitter.js";
import { Upscaler, UpscalerError } from "../supersampler.js";

const FRAME_FLOATS = 24;

export class ThreeUpscaling {
  /**
   * @param {import("three/webgpu").WebGPURenderer} renderer initialised, on its WebGPU backend, without antialias
   * @param {{ displaySize: [number, number], ratio: number, models: string | URL }} options models: a folder of
   *   `supersampler export METHOD --target wgsl`
   * @returns {Promise<ThreeUpscaling>}
   * @throws {UpscalerError} as `Upscaler.load`, or the ratio is not the method's
   */
  static async make(renderer, { displaySize, ratio, models }) {
    const { device } = renderer.backend;
    const code = await (await fetch(new URL("inputs.wgsl", import.meta.url))).text();
    const upscaler = await Upscaler.load(device, models, { displaySize }), [low, high] = upscaler.info.ratios;
    if (!(ratio >= low && ratio <= high)) throw new UpscalerError("ratio", ratio, `${low} to ${high}`, "Take another method, or another ratio.");
    return new ThreeUpscaling(renderer, displaySize, ratio, code, upscaler);
  }

  /** Use `ThreeUpscaling.make`. */
  constructor(renderer, displaySize, ratio, code, upscaler) {
    this.renderer = renderer;
    this.ratio = ratio;
    this.upscaler = upscaler;
    this.device = renderer.backend.device;
    const [width, height] = displaySize.map((side) => Math.round(side / ratio));
    /** @type {[number, number]} */ this.size = [width, height];
    this.target = new RenderTarget(width, height, {
      count: 2, type: HalfFloatType, minFilter: NearestFilter, magFilter: NearestFilter, depthTexture: new DepthTexture(width, height, FloatType),
    });
    this.target.textures[0].name = "output";
    this.target.textures[1].name = "velocity";
    this.passes = mrt({ output, velocity });
    this.index = 0;
    this.previousClip = new Matrix4();
    this.#allocate(displaySize, code);
  }

  #allocate(displaySize, code) {
    const { device, size } = this, { STORAGE_BINDING, TEXTURE_BINDING, COPY_SRC } = GPUTextureUsage;
    const texture = (format, of) => device.createTexture({ size: of, format, usage: STORAGE_BINDING | TEXTURE_BINDING | COPY_SRC });
    this.depth = texture("r32float", size);
    this.motion = texture("rg32float", size);
    this.output = texture("rgba16float", displaySize);
    /** The upscaled image, linear, as three.js takes textures. */
    this.texture = new ExternalTexture(this.output);
    Object.assign(this.texture, { type: HalfFloatType, image: { width: displaySize[0], height: displaySize[1] } });
    this.uniforms = device.createBuffer({ size: 4 * FRAME_FLOATS, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
    const module = device.createShaderModule({ label: "inputs.wgsl", code });
    this.pipeline = device.createComputePipeline({ layout: "auto", compute: { module } });
  }

  /**
   * Draws the scene at render size, and upscales it.
   * @param {import("three/webgpu").Scene} scene @param {import("three/webgpu").PerspectiveCamera} camera
   * @param {{ reset?: boolean }} [options] reset: true on the first frame after a cut
   */
  render(scene, camera, { reset = false } = {}) {
    const [width, height] = this.size, jitter = haltonJitter(this.index++, this.ratio);
    camera.updateMatrixWorld();
    const clip = new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse);
    if (this.index === 1 || reset) this.previousClip.copy(clip);
    velocity.setProjectionMatrix(camera.projectionMatrix.clone()); // without jitter
    camera.setViewOffset(width, height, jitter[0], jitter[1], width, height); // a pixel shows its centre + jitter
    const before = [this.renderer.getRenderTarget(), this.renderer.getMRT()];
    this.renderer.setRenderTarget(this.target);
    this.renderer.setMRT(this.passes);
    this.renderer.render(scene, camera);
    this.renderer.setRenderTarget(before[0]);
    this.renderer.setMRT(before[1]);
    camera.clearViewOffset();
    velocity.setProjectionMatrix(null);
    this.#upscale(jitter, clip, camera.near / camera.far, reset);
    this.previousClip.copy(clip);
  }

  /** Frees its memory on the device, when the display size changes or nothing is drawn any more. */
  destroy() {
    this.target.dispose();
    this.upscaler.destroy();
    for (const resource of [this.depth, this.motion, this.output, this.uniforms]) resource.destroy();
  }

  #upscale(jitter, clip, nearOverFar, reset) {
    const { device } = this, [color, velocities] = this.target.textures.map((one) => this.renderer.backend.get(one).texture);
    const toPrevious = new Matrix4().multiplyMatrices(this.previousClip, clip.clone().invert());
    device.queue.writeBuffer(this.uniforms, 0, new Float32Array([...toPrevious.elements, ...this.size, ...jitter, nearOverFar, 0, 0, 0]));
    const resources = [
      { buffer: this.uniforms }, this.renderer.backend.get(this.target.depthTexture).texture.createView(),
      velocities.createView(), this.depth.createView(), this.motion.createView(),
    ];
    const group = device.createBindGroup({
      layout: this.pipeline.getBindGroupLayout(0), entries: resources.map((resource, binding) => ({ binding, resource })),
    });
    const encoder = device.createCommandEncoder(), pass = encoder.beginComputePass();
    pass.setPipeline(this.pipeline);
    pass.setBindGroup(0, group);
    pass.dispatchWorkgroups(Math.ceil(this.size[0] / 8), Math.ceil(this.size[1] / 8));
    pass.end();
    this.upscaler.encode(encoder, { color, depth: this.depth, motion: this.motion }, this.output, { jitter, reset });
    device.queue.submit([encoder.finish()]);
  }
}
