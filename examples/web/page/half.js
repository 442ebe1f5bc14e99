/** Half floats as their 16 bits. */

export const HALF_ONE = 0x3c00;

const FLOATS = new Float32Array(1 << 16).map((_, bits) => {
  const sign = bits & 0x8000 ? -1 : 1, exponent = (bits >> 10) & 31, part = bits & 1023;
  if (exponent === 0) return sign * part * 2 ** -24;
  if (exponent === 31) return part ? NaN : sign * Infinity;
  return sign * (1 + part / 1024) * 2 ** (exponent - 15);
});

/** @param {Uint16Array} halves @returns {Float32Array} */
export const floatsOf = (halves) => Float32Array.from(halves, (bits) => FLOATS[bits]);
