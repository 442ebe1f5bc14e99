/** Jitter of frames: Halton's sequence, 8 ratio^2 places in the pixel. */

import { UpscalerError, shown } from "./supersampler_folder.js";

/**
 * @param {number} index of the frame @param {number} ratio display over render size
 * @returns {[number, number]} pixels, in [-0.5, 0.5)
 * @throws {UpscalerError} an argument is not as described
 */
export function haltonJitter(index, ratio) {
  if (!(Number.isInteger(index) && index >= 0)) throw new UpscalerError("index", shown(index), "the number of a frame, from 0 on");
  if (!(ratio > 0 && ratio < Infinity)) throw new UpscalerError("ratio", shown(ratio), "display size / render size, > 0");
  const phase = (index % Math.max(Math.floor(8 * ratio * ratio), 1)) + 1;
  return [radicalInverse(phase, 2) - 0.5, radicalInverse(phase, 3) - 0.5];
}

function radicalInverse(index, base) {
  let result = 0;
  for (let part = 1 / base; index > 0; part /= base, index = Math.floor(index / base)) result += part * (index % base);
  return result;
}
