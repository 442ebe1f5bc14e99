/** The presenter on a 2D canvas, for browsers without WebGPU. */

const STEPS = 4096; // of the curve from tone-mapped light to sRGB

const SRGB = Uint8ClampedArray.from({ length: STEPS + 1 }, (_, i) => {
  const linear = i / STEPS;
  return 255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055);
});

export class CanvasPresenter {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    /** @type {Map<string, OffscreenCanvas>} */ this.views = new Map();
    /** @type {[number, number]} of the input, pixels */ this.jitter = [0, 0];
  }

  /**
   * @param {string} view one of VIEWS @param {[number, number]} size width and height
   * @param {Float32Array[]} planes red, green, blue, linear @param {number} exposure
   */
  set(view, size, planes, exposure) {
    const canvas = new OffscreenCanvas(...size), image = new ImageData(...size);
    const [red, green, blue] = planes;
    for (let i = 0; i < red.length; i++) {
      const scale = (STEPS * exposure) / (1 + exposure * Math.max(red[i], green[i], blue[i], 0));
      image.data[4 * i] = SRGB[Math.round(Math.max(red[i], 0) * scale)];
      image.data[4 * i + 1] = SRGB[Math.round(Math.max(green[i], 0) * scale)];
      image.data[4 * i + 2] = SRGB[Math.round(Math.max(blue[i], 0) * scale)];
      image.data[4 * i + 3] = 255;
    }
    canvas.getContext("2d").putImageData(image, 0, 0);
    this.views.set(view, canvas);
  }

  /** @param {import("./presenter.js").Shown} shown */
  present({ left, right, split, zoom, origin }) {
    const { canvas, context } = this, [width, height] = [canvas.width, canvas.height];
    const edge = Math.round(split * width);
    context.fillRect(0, 0, width, height);
    for (const [view, from, to] of [[left, 0, edge], [right, edge, width]]) {
      const image = this.views.get(view === "bilinear" ? "input" : view);
      if (!image || from === to) continue;
      const scale = [image.width / width, image.height / height], smooth = view === "bilinear";
      const [shiftX, shiftY] = smooth ? this.jitter : [0, 0];
      context.imageSmoothingEnabled = smooth;
      context.drawImage(
        image, (origin[0] + from / zoom) * scale[0] - shiftX, origin[1] * scale[1] - shiftY,
        ((to - from) / zoom) * scale[0], (height / zoom) * scale[1], from, 0, to - from, height,
      );
    }
  }
}
