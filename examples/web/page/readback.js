/** Reads textures back, for the tests of this page. */

import { floatsOf } from "./half.js";

/**
 * @param {GPUDevice} device @param {GPUTexture} texture rgba16float or rgba32float, with COPY_SRC
 * @returns {Promise<Float32Array>} RGBA, row 0 on top
 */
export async function readTexture(device, texture) {
  const { width, height, format } = texture, pixelBytes = format === "rgba32float" ? 16 : 8;
  const bytesPerRow = Math.ceil((pixelBytes * width) / 256) * 256;
  const buffer = device.createBuffer({ size: bytesPerRow * height, usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ });
  const encoder = device.createCommandEncoder();
  encoder.copyTextureToBuffer({ texture }, { buffer, bytesPerRow }, [width, height]);
  device.queue.submit([encoder.finish()]);
  await buffer.mapAsync(GPUMapMode.READ);
  const bytes = buffer.getMappedRange(), pixels = new Float32Array(4 * width * height);
  for (let row = 0; row < height; row++) {
    const values = pixelBytes === 16
      ? new Float32Array(bytes, row * bytesPerRow, 4 * width)
      : floatsOf(new Uint16Array(bytes, row * bytesPerRow, 4 * width));
    pixels.set(values, 4 * width * row);
  }
  buffer.destroy();
  return pixels;
}
