/**
 * The page of three.js: a scene upscaled by the node of this package, or by three.js' own ones.
 * `?method=taau&size=640x360&scale=0.5` choose; `&test` draws nothing by itself, for `window.threeDemo`.
 */

import { ACESFilmicToneMapping, RenderPipeline, WebGPURenderer } from "three/webgpu";
import { float, mrt, output, pass, screenUV, select, uniform, velocity } from "three/tsl";
import { taau } from "three/addons/tsl/display/TAAUNode.js";
import { traa } from "three/addons/tsl/display/TRAANode.js";
import models from "../models/index.js";
import { makeCourtyard } from "./courtyard.js";
import { sharpTextures, supersampler } from "./node.js";
import { ThreeTesting } from "./testing.js";

const FIRST_TIME = 1;
const OTHERS = {
  "three-taau": taau, "three-taau-sharp": taau, "three-traa": traa, // of three.js; TRAA does not upscale
  bilinear: (beauty) => beauty,
};

/**
 * @param {{ canvas: HTMLCanvasElement, split: HTMLInputElement, methods: HTMLSelectElement, query: URLSearchParams, show: (text: string) => void }} page
 */
export async function startThree({ canvas, split, methods, query, show }) {
  const displaySize = (query.get("size") ?? "960x540").split("x").map(Number), method = query.get("method") ?? "classifier";
  for (const name of [...Object.keys(models), ...Object.keys(OTHERS)]) methods.append(new Option(name, name, false, name === method));
  methods.addEventListener("change", () => {
    query.set("method", methods.value);
    location.search = query;
  });
  const scale = method === "three-traa" ? 1 : Number(query.get("scale") ?? 0.5);
  const renderer = new WebGPURenderer({ canvas, antialias: false });
  renderer.toneMapping = ACESFilmicToneMapping;
  renderer.shadowMap.enabled = true;
  renderer.setSize(...displaySize, false);
  await renderer.init();
  const { scene, camera, animate } = makeCourtyard(displaySize[0] / displaySize[1]);

  const scenePass = pass(scene, camera).setMRT(mrt({ output, velocity }));
  scenePass.setResolutionScale(scale);
  if (method === "three-taau-sharp") scenePass.contextNode = sharpTextures(float(scale));
  const [beauty, depth, motion] = ["output", "depth", "velocity"].map((name) => scenePass.getTextureNode(name));
  const pipeline = new RenderPipeline(renderer), upscale = OTHERS[method] ?? supersampler;
  const upscaled = upscale(beauty, depth, motion, camera, { method });

  if (query.has("test")) {
    pipeline.outputNode = upscaled;
    window.threeDemo = new ThreeTesting({ renderer, pipeline, scene, camera, animate, upscaled, displaySize });
    return;
  }
  const edge = uniform(0.5);
  pipeline.outputNode = select(screenUV.x.lessThan(edge), beauty, upscaled);
  let last;
  renderer.setAnimationLoop((now) => {
    const elapsed = now - (last ?? now);
    last = now;
    show(`${displaySize.map((side) => Math.floor(scale * side)).join("x")} to ${displaySize.join("x")}, ${method}, ${elapsed.toFixed(0)} ms from frame to frame`);
    animate(FIRST_TIME + now / 1000);
    edge.value = Number(split.value);
    pipeline.render();
  });
}
