/** Jitter of frames: Halton's sequence, 8 ratio^2 places in the pixel. */

/**
 * @param {number} index of the frame @param {number} ratio display over render size
 * @returns {[number, number]} pixels, in [-0.5, 0.5)
 */
export function haltonJitter(index, ratio) {
  const phase = (index % Math.floor(8 * ratio * ratio)) + 1;
  return [radicalInverse(phase, 2) - 0.5, radicalInverse(phase, 3) - 0.5];
}

function radicalInverse(index, base) {
  let result = 0;
  for (let part = 1 / base; index > 0; part /= base, index = Math.floor(index / base)) result += part * (index % base);
  return result;
}
