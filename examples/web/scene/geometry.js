/**
 * Meshes made in code. A vertex is eight floats: position, normal, texture coordinates.
 * @typedef {import("./matrix.js").Vector} Vector
 * @typedef {{ vertices: number[], indices: number[] }} Mesh
 */

import { cross, subtract, unit } from "./matrix.js";

export const VERTEX_FLOATS = 8;

/** @param {Mesh[]} meshes @returns {Mesh} one mesh of all triangles */
export function merged(meshes) {
  const whole = { vertices: [], indices: [] };
  for (const mesh of meshes) {
    const first = whole.vertices.length / VERTEX_FLOATS;
    for (const value of mesh.vertices) whole.vertices.push(value);
    for (const index of mesh.indices) whole.indices.push(first + index);
  }
  return whole;
}

/**
 * A rectangle from `corner` along two sides; texture coordinates are lengths along the sides.
 * @param {Vector} corner @param {Vector} right @param {Vector} up @returns {Mesh}
 */
export function rectangle(corner, right, up) {
  const normal = unit(cross(right, up));
  const width = Math.hypot(...right), height = Math.hypot(...up);
  const vertices = [];
  for (const [a, b] of [[0, 0], [1, 0], [1, 1], [0, 1]]) {
    vertices.push(...corner.map((value, axis) => value + a * right[axis] + b * up[axis]), ...normal, a * width, b * height);
  }
  return { vertices, indices: [0, 1, 2, 0, 2, 3] };
}

/** An axis-aligned box. @param {Vector} low @param {Vector} high @returns {Mesh} */
export function box(low, high) {
  const [w, h, d] = subtract(high, low);
  return merged([
    rectangle([low[0], low[1], high[2]], [w, 0, 0], [0, h, 0]),
    rectangle([high[0], low[1], low[2]], [-w, 0, 0], [0, h, 0]),
    rectangle([high[0], low[1], high[2]], [0, 0, -d], [0, h, 0]),
    rectangle([low[0], low[1], low[2]], [0, 0, d], [0, h, 0]),
    rectangle([low[0], high[1], high[2]], [w, 0, 0], [0, 0, -d]),
    rectangle([low[0], low[1], low[2]], [w, 0, 0], [0, 0, d]),
  ]);
}

/**
 * A tube along points.
 * @param {Vector[]} points @param {number} radius @param {number} sides of its cross-section
 * @param {boolean} closed whether the last point leads to the first
 * @returns {Mesh}
 */
export function tube(points, radius, sides, closed = false) {
  const vertices = [], indices = [], count = points.length;
  for (let i = 0; i < count; i++) {
    const before = closed ? points[(i + count - 1) % count] : points[Math.max(i - 1, 0)];
    const after = closed ? points[(i + 1) % count] : points[Math.min(i + 1, count - 1)];
    const along = unit(subtract(after, before));
    const across = unit(cross(along, Math.abs(along[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0]));
    const third = cross(along, across);
    for (let side = 0; side < sides; side++) {
      const angle = (2 * Math.PI * side) / sides, c = Math.cos(angle), s = Math.sin(angle);
      const normal = across.map((value, axis) => c * value + s * third[axis]);
      vertices.push(...points[i].map((value, axis) => value + radius * normal[axis]), ...normal, i, side / sides);
    }
  }
  for (let i = 0; i < (closed ? count : count - 1); i++) {
    for (let side = 0; side < sides; side++) {
      const a = i * sides + side, b = i * sides + ((side + 1) % sides);
      const c = ((i + 1) % count) * sides + side, d = ((i + 1) % count) * sides + ((side + 1) % sides);
      indices.push(a, c, b, b, c, d);
    }
  }
  return { vertices, indices };
}

/** A sphere about the origin. @param {number} radius @param {number} rings @returns {Mesh} */
export function sphere(radius, rings) {
  const vertices = [], indices = [], columns = 2 * rings;
  for (let ring = 0; ring <= rings; ring++) {
    const polar = (Math.PI * ring) / rings;
    for (let column = 0; column <= columns; column++) {
      const angle = (2 * Math.PI * column) / columns;
      const normal = [Math.sin(polar) * Math.cos(angle), Math.cos(polar), Math.sin(polar) * Math.sin(angle)];
      vertices.push(...normal.map((value) => radius * value), ...normal, column / columns, ring / rings);
    }
  }
  for (let ring = 0; ring < rings; ring++) {
    for (let column = 0; column < columns; column++) {
      const a = ring * (columns + 1) + column, b = a + columns + 1;
      indices.push(a, a + 1, b, b, a + 1, b + 1);
    }
  }
  return { vertices, indices };
}

/** A torus knot about the y axis. @param {number} radius @param {number} thickness @returns {Mesh} */
export function knot(radius, thickness) {
  const points = [], count = 160;
  for (let i = 0; i < count; i++) {
    const t = (2 * Math.PI * i) / count, r = radius * (1 + 0.4 * Math.cos(3 * t));
    points.push([r * Math.cos(2 * t), 0.4 * radius * Math.sin(3 * t), r * Math.sin(2 * t)]);
  }
  return tube(points, thickness, 12, true);
}

/**
 * A fence of crossing wires in the plane z = 0, with posts.
 * @param {number} width @param {number} height @param {number} mesh distance of the wires @param {number} radius
 * @returns {Mesh}
 */
export function fence(width, height, mesh, radius) {
  const parts = [];
  for (let at = -height; at < width; at += mesh) {
    const first = Math.max(at, 0), last = Math.min(at + height, width);
    if (last <= first) continue;
    parts.push(tube([[first, first - at, 0], [last, last - at, 0]], radius, 4));
    parts.push(tube([[first, height - (first - at), 0.01], [last, height - (last - at), 0.01]], radius, 4));
  }
  for (let x = 0; x <= width; x += width / 4) parts.push(tube([[x, 0, 0], [x, height + 0.08, 0]], 0.035, 8));
  parts.push(tube([[0, height, 0], [width, height, 0]], 0.02, 6));
  return merged(parts);
}

/** A wheel in the plane z = 0: rims and thin spokes. @param {number} radius @returns {Mesh} */
export function wheel(radius) {
  const circle = (r) => Array.from({ length: 48 }, (_, i) => {
    const angle = (2 * Math.PI * i) / 48;
    return [r * Math.cos(angle), r * Math.sin(angle), 0];
  });
  const parts = [tube(circle(radius), 0.035, 8, true), tube(circle(0.12 * radius), 0.03, 6, true)];
  for (let i = 0; i < 18; i++) {
    const angle = (2 * Math.PI * i) / 18, c = Math.cos(angle), s = Math.sin(angle);
    parts.push(tube([[0.12 * radius * c, 0.12 * radius * s, 0], [radius * c, radius * s, 0]], 0.008, 4));
  }
  return merged(parts);
}

/**
 * A cable that hangs between two points.
 * @param {Vector} from @param {Vector} to @param {number} sag @param {number} radius @returns {Mesh}
 */
export function cable(from, to, sag, radius) {
  const points = Array.from({ length: 25 }, (_, i) => {
    const t = i / 24, along = from.map((value, axis) => value + t * (to[axis] - value));
    along[1] -= 4 * sag * t * (1 - t);
    return /** @type {Vector} */ (along);
  });
  return tube(points, radius, 4);
}
