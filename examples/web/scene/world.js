/**
 * The scene: a yard with a fence, a spoked wheel, cables, a knot that turns, a mirror on a brick wall and three
 * lights that move. Lengths are metres, y is up.
 * @typedef {import("./matrix.js").Matrix} Matrix
 * @typedef {import("./matrix.js").Vector} Vector
 * @typedef {import("./geometry.js").Mesh} Mesh
 *
 * @typedef {object} Thing
 * @property {Mesh} mesh
 * @property {number} surface one of SURFACES
 * @property {Vector} color linear RGB; of a light, what it emits
 * @property {number} [gloss] 0 (matt) to 1
 * @property {(time: number) => Matrix} place model to world at a time in seconds
 */

import { box, cable, fence, knot, rectangle, sphere, tube, wheel } from "./geometry.js";
import { lookAt, product, scaling, translation, turnX, turnY, turnZ } from "./matrix.js";

/** Kinds of surfaces, as scene.wgsl numbers them. */
export const SURFACES = { plain: 0, tiles: 1, bricks: 2, mirror: 3, light: 4 };
export const MIRROR_Z = -5.92;
export const NEAR = 0.1;
export const FOV_Y = 0.85;
/** Direction to the sun, not of unit length. @type {Vector} */
export const SUN = [0.55, 0.9, 0.6];

const LIGHTS = [
  { color: [30, 11, 3], path: (t) => [2.6 * Math.sin(0.9 * t), 0.9, -2.6 + 1.5 * Math.cos(0.9 * t)] },
  { color: [3, 12, 30], path: (t) => [-2.4 + 1.2 * Math.sin(1.3 * t), 2.3, -4.4 + 0.6 * Math.cos(1.3 * t)] },
  { color: [6, 26, 8], path: (t) => [3.4, 0.5 + 1.2 * Math.abs(Math.sin(1.1 * t)), -4.3 + 0.8 * Math.sin(0.5 * t)] },
];

const still = () => translation(0, 0, 0);

/** @returns {Thing[]} things that do not change but for their place */
export function makeThings() {
  const poles = [[-6, -4.6], [6, -3.8]].map(([x, z]) => tube([[x, 0, z], [x, 4.6, z]], 0.08, 10));
  const cables = [0, 1, 2, 3, 4].map((i) => cable([-6, 4.4 - 0.22 * i, -4.6], [6, 4.5 - 0.22 * i, -3.8], 0.35 + 0.05 * i, 0.009));
  return [
    { mesh: rectangle([-30, 0, 20], [60, 0, 0], [0, 0, -60]), surface: SURFACES.tiles, color: [0.5, 0.48, 0.44], place: still },
    { mesh: box([-7, 0, -6.4], [7, 3.2, -6]), surface: SURFACES.bricks, color: [0.42, 0.17, 0.11], place: still },
    { mesh: box([-2.1, 0.2, -6], [2.1, 2.9, MIRROR_Z - 0.01]), surface: SURFACES.plain, color: [0.05, 0.04, 0.035], place: still },
    { mesh: rectangle([-2, 0.3, MIRROR_Z], [4, 0, 0], [0, 2.5, 0]), surface: SURFACES.mirror, color: [0.86, 0.88, 0.9], place: still },
    ...[...poles, ...cables].map((mesh) => ({ mesh, surface: SURFACES.plain, color: [0.03, 0.03, 0.035], gloss: 0.3, place: still })),
    { mesh: fence(4.4, 1.9, 0.13, 0.008), surface: SURFACES.plain, color: [0.35, 0.38, 0.4], gloss: 0.5,
      place: () => product(translation(1.3, 0, -1.2), turnY(0.35)) },
    { mesh: wheel(1.15), surface: SURFACES.plain, color: [0.5, 0.1, 0.06], gloss: 0.5,
      place: (t) => product(translation(-3.1, 1.25, -2.6), turnY(0.5), turnZ(-0.7 * t)) },
    { mesh: knot(0.62, 0.17), surface: SURFACES.plain, color: [0.75, 0.55, 0.2], gloss: 1,
      place: (t) => product(translation(-0.2, 1.2, -2.9), turnY(0.8 * t), turnX(0.5)) },
    { mesh: box([-0.45, 0, -0.45], [0.45, 0.28, 0.45]), surface: SURFACES.plain, color: [0.5, 0.5, 0.5],
      place: () => translation(-0.2, 0, -2.9) },
    ...[0, 1, 2, 3, 4].map((i) => ({
      mesh: box([-0.25, 0, -0.25], [0.25, 0.5 + 0.3 * i, 0.25]), surface: SURFACES.plain,
      color: [0.25 + 0.1 * i, 0.4, 0.55 - 0.08 * i], place: () => product(translation(3.2 + 0.62 * i, 0, -5), turnY(0.3 * i)),
    })),
    ...LIGHTS.map((light) => ({
      mesh: sphere(1, 12), surface: SURFACES.light, color: light.color,
      place: (t) => product(translation(...light.path(t)), scaling(0.11, 0.11, 0.11)),
    })),
  ];
}

/** @param {number} time @returns {{ position: Vector, color: Vector }[]} the lights at a time */
export const lightsAt = (time) => LIGHTS.map(({ color, path }) => ({ position: path(time), color }));

/** @param {number} time of the camera, in seconds @returns {{ eye: Vector, view: Matrix }} */
export function cameraAt(time) {
  const eye = [2.6 * Math.sin(0.45 * time), 1.75 + 0.25 * Math.sin(0.6 * time), 3.1 + 0.7 * Math.cos(0.37 * time)];
  return { eye, view: lookAt(eye, [0.15 * eye[0], 1.35, -3]) };
}
