/**
 * The page of three.js: its own rendering, enlarged, left of the split, and upscaled right of it.
 * `?frames=N` stops after N frames with a fixed time step, for tests; `&size=320x180&method=taau` are the others.
 */

import { ACESFilmicToneMapping, NodeMaterial, QuadMesh, WebGPURenderer } from "three/webgpu";
import { screenUV, select, texture, uniform } from "three/tsl";
import { ThreeTesting } from "./testing.js";
import { ThreeUpscaling } from "./upscaling.js";
import { makeYard } from "./yard.js";

const STEP = 1 / 60, FIRST_TIME = 3, LONGEST_STEP = 1 / 15;

/** @param {{ canvas: HTMLCanvasElement, split: HTMLInputElement, query: URLSearchParams, show: (text: string) => void }} page */
export async function startThree({ canvas, split, query, show }) {
  const displaySize = (query.get("size") ?? "960x540").split("x").map(Number), ratio = Number(query.get("ratio") ?? 2);
  const method = query.get("method") ?? "classifier", frames = Number(query.get("frames") ?? Infinity);
  if (!/^[a-z-]+$/.test(method)) throw new Error(`There is no method ${method}.`); // it is part of an address
  const renderer = new WebGPURenderer({ canvas, antialias: false });
  renderer.toneMapping = ACESFilmicToneMapping;
  await renderer.init();
  if (!renderer.backend.isWebGPUBackend) throw new Error("This browser has no WebGPU; three.js fell back to WebGL, which cannot run the upscaler.");
  const upscaling = await ThreeUpscaling.make(renderer, { displaySize, ratio, models: new URL(`../models/${method}/`, import.meta.url) });
  renderer.setSize(...displaySize, false);
  const { scene, camera, animate } = makeYard(displaySize[0] / displaySize[1], ratio);
  const edge = uniform(0.5), quad = new QuadMesh(new NodeMaterial());
  quad.material.fragmentNode = select(screenUV.x.lessThan(edge), texture(upscaling.target.textures[0]), texture(upscaling.texture)).renderOutput();

  let index = 0, time = FIRST_TIME, last;
  renderer.setAnimationLoop((now) => {
    time += Number.isFinite(frames) ? STEP : Math.min((now - (last ?? now)) / 1000, LONGEST_STEP);
    show(`${upscaling.size.join("x")} to ${displaySize.join("x")}, ${method}, ${(now - (last ?? now)).toFixed(0)} ms from frame to frame`);
    last = now;
    animate(time);
    edge.value = Number(split.value);
    upscaling.render(scene, camera);
    quad.render(renderer);
    if (++index === 1) performance.mark("first-image");
    if (index < frames) return;
    renderer.setAnimationLoop(null);
    window.threeDemo = new ThreeTesting(upscaling, scene, camera);
  });
}
