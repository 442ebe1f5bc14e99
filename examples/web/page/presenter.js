/** Draws two views on a canvas, left and right of a split. */

/** The views, as present.wgsl numbers them. */
export const VIEWS = ["input", "bilinear", "ours", "truth"];

/**
 * @typedef {object} Shown what the stage shows
 * @property {string} left one of VIEWS @property {string} right one of VIEWS
 * @property {number} split 0 to 1 @property {number} zoom canvas pixels for one of the image
 * @property {[number, number]} origin image pixel at the canvas' corner
 */

export class Presenter {
  /**
   * @param {GPUDevice} device @param {HTMLCanvasElement} canvas
   * @returns {Promise<Presenter>}
   */
  static async make(device, canvas) {
    const code = await (await fetch(new URL("present.wgsl", import.meta.url))).text();
    return new Presenter(device, canvas, code);
  }

  /** @param {GPUDevice} device @param {HTMLCanvasElement} canvas @param {string} code of present.wgsl */
  constructor(device, canvas, code) {
    this.device = device;
    this.canvas = canvas;
    this.context = /** @type {GPUCanvasContext} */ (canvas.getContext("webgpu"));
    const format = navigator.gpu.getPreferredCanvasFormat();
    this.context.configure({ device, format, alphaMode: "opaque" });
    const module = device.createShaderModule({ label: "present.wgsl", code });
    const layout = device.createBindGroupLayout({
      entries: [
        { binding: 0, visibility: GPUShaderStage.FRAGMENT, buffer: { type: "uniform" } },
        ...[1, 2, 3].map((binding) => ({ binding, visibility: GPUShaderStage.FRAGMENT, texture: { sampleType: "unfilterable-float" } })),
      ],
    });
    this.pipeline = device.createRenderPipeline({
      layout: device.createPipelineLayout({ bindGroupLayouts: [layout] }),
      vertex: { module },
      fragment: { module, targets: [{ format }] },
    });
    this.black = device.createTexture({ size: [1, 1], format: "rgba8unorm", usage: GPUTextureUsage.TEXTURE_BINDING });
    this.uniforms = device.createBuffer({ size: 48, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
  }

  /**
   * @param {GPUCommandEncoder} encoder @param {import("./live_source.js").SourceFrame} frame
   * @param {GPUTexture} ours the upscaled image @param {Shown} shown @param {GPURenderPassTimestampWrites} [timestampWrites]
   */
  encode(encoder, frame, ours, shown, timestampWrites) {
    const data = new DataView(new ArrayBuffer(48));
    [...shown.origin, shown.zoom, shown.split * this.canvas.width, ...frame.jitter, frame.exposure]
      .forEach((value, i) => data.setFloat32(4 * i, value, true));
    data.setUint32(28, VIEWS.indexOf(shown.left), true);
    data.setUint32(32, VIEWS.indexOf(shown.right), true);
    this.device.queue.writeBuffer(this.uniforms, 0, data);
    const textures = [frame.color, ours, frame.truth ?? this.black];
    const group = this.device.createBindGroup({
      layout: this.pipeline.getBindGroupLayout(0),
      entries: [
        { binding: 0, resource: { buffer: this.uniforms } },
        ...textures.map((texture, i) => ({ binding: i + 1, resource: texture.createView() })),
      ],
    });
    const pass = encoder.beginRenderPass({
      colorAttachments: [{ view: this.context.getCurrentTexture().createView(), loadOp: "clear", storeOp: "store" }],
      timestampWrites,
    });
    pass.setPipeline(this.pipeline);
    pass.setBindGroup(0, group);
    pass.draw(3);
    pass.end();
  }
}
