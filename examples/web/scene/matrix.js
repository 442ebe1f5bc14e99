/**
 * 4x4 matrices for column vectors, stored column by column, as WGSL's mat4x4f.
 * @typedef {Float32Array} Matrix
 * @typedef {[number, number, number]} Vector
 */

/** @param {Matrix} a @param {Matrix} b @returns {Matrix} a b */
export function multiply(a, b) {
  const product = new Float32Array(16);
  for (let column = 0; column < 4; column++) {
    for (let row = 0; row < 4; row++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += a[4 * k + row] * b[4 * column + k];
      product[4 * column + row] = sum;
    }
  }
  return product;
}

/** @param {...Matrix} matrices @returns {Matrix} their product, from left to right */
export const product = (...matrices) => matrices.reduce(multiply);

/** @param {number} x @param {number} y @param {number} z @returns {Matrix} */
export const translation = (x, y, z) => new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z, 1]);

/** @param {number} x @param {number} y @param {number} z @returns {Matrix} */
export const scaling = (x, y, z) => new Float32Array([x, 0, 0, 0, 0, y, 0, 0, 0, 0, z, 0, 0, 0, 0, 1]);

/** @param {number} angle radians about x @returns {Matrix} */
export function turnX(angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return new Float32Array([1, 0, 0, 0, 0, c, s, 0, 0, -s, c, 0, 0, 0, 0, 1]);
}

/** @param {number} angle radians about y @returns {Matrix} */
export function turnY(angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return new Float32Array([c, 0, -s, 0, 0, 1, 0, 0, s, 0, c, 0, 0, 0, 0, 1]);
}

/** @param {number} angle radians about z @returns {Matrix} */
export function turnZ(angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return new Float32Array([c, s, 0, 0, -s, c, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
}

/**
 * Reflection at the plane z = `z`.
 * @param {number} z @returns {Matrix}
 */
export const reflectionAtZ = (z) => new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 2 * z, 1]);

/** @param {Vector} a @param {Vector} b @returns {Vector} */
export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];

/** @param {Vector} a @param {Vector} b @returns {Vector} */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** @param {Vector} a @param {Vector} b @returns {number} */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** @param {Vector} a @returns {Vector} */
export function unit(a) {
  const length = Math.hypot(...a);
  return [a[0] / length, a[1] / length, a[2] / length];
}

/**
 * World to view coordinates: the camera looks along -z, y is up.
 * @param {Vector} eye @param {Vector} target @returns {Matrix}
 */
export function lookAt(eye, target) {
  const z = unit(subtract(eye, target)), x = unit(cross([0, 1, 0], z)), y = cross(z, x);
  return new Float32Array([
    x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, -dot(x, eye), -dot(y, eye), -dot(z, eye), 1,
  ]);
}

/**
 * Perspective with reversed, infinite depth: z-buffer = near / view distance, 0 at infinity.
 * @param {number} fovY radians @param {number} aspect width / height @param {number} near
 * @returns {Matrix}
 */
export function perspective(fovY, aspect, near) {
  const f = 1 / Math.tan(fovY / 2);
  return new Float32Array([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, 0, -1, 0, 0, near, 0]);
}

/**
 * Parallel projection of a box around the origin of view coordinates; depth from 0 (near) to 1.
 * @param {number} half half of its width and height @param {number} depth @returns {Matrix}
 */
export function parallel(half, depth) {
  return new Float32Array([1 / half, 0, 0, 0, 0, 1 / half, 0, 0, 0, 0, -1 / depth, 0, 0, 0, 0, 1]);
}
