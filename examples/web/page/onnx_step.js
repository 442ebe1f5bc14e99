/**
 * The step as one ONNX graph, in ONNX Runtime Web: docs/contract.md.
 * @typedef {import("./shot_folder.js").ShotFrame} ShotFrame
 */

import { asFloat } from "./shot_source.js";

const RUNTIME = new URL("../vendor/onnxruntime-web/", import.meta.url);
const CONTRACT = 4;
const MODELS = new URL("../onnx/", import.meta.url);

/**
 * ONNX Runtime Web from this folder.
 * @returns {Promise<{ ort: any, providers: string[] }>}
 * @throws {TypeError} it is not part of the folder
 */
export async function loadRuntime() {
  const adapter = await navigator.gpu?.requestAdapter(), hasGpu = Boolean(adapter && !adapter.info.isFallbackAdapter);
  const ort = await import(new URL(hasGpu ? "ort.webgpu.min.mjs" : "ort.wasm.min.mjs", RUNTIME).href);
  ort.env.logLevel = "error";
  ort.env.wasm.wasmPaths = RUNTIME.href;
  ort.env.wasm.numThreads = 1; // several need headers that plain file hosts do not send
  return { ort, providers: hasGpu ? ["webgpu", "wasm"] : ["wasm"] };
}

export class OnnxStep {
  /** @param {{ ort: any, providers: string[] }} runtime @param {string} method @returns {Promise<OnnxStep>} */
  static async load({ ort, providers }, method) {
    const folder = new URL(`${method}/`, MODELS);
    const contract = await (await fetch(new URL("model.json", folder))).json();
    if (contract.contract !== CONTRACT) throw new TypeError(`${folder}: contract ${contract.contract}; want ${CONTRACT}`);
    const session = await ort.InferenceSession.create(new URL("step.onnx", folder).href, { executionProviders: providers });
    return new OnnxStep(ort, contract, session);
  }

  /** @param {any} ort the runtime @param {any} contract of model.json @param {any} session of step.onnx */
  constructor(ort, contract, session) {
    this.ort = ort;
    this.contract = contract;
    this.session = session;
    /** @type {Record<string, any>} tensors by name; all zeros mean no history */ this.history = {};
  }

  /**
   * @param {ShotFrame} frame @param {number} exposure @param {[number, number]} displaySize
   * @returns {Promise<Float32Array>} planes of red, green, blue at display size, linear
   */
  async step(frame, exposure, displaySize) {
    const { Tensor } = this.ort, [w, h] = frame.size, [displayW, displayH] = displaySize;
    const image = (planes) => new Tensor("float32", joined(planes), [1, planes.length, h, w]);
    const inputs = {
      color: image(frame.color), depth: image([frame.depth]), motion: image(frame.motion),
      jitter: new Tensor("float32", Float32Array.from(frame.jitter), [1, 2]),
      exposure: new Tensor("float32", Float32Array.of(exposure), [1]),
      reactive: new Tensor("float32", new Float32Array(w * h), [1, 1, h, w]), // none
      pre_exposure: new Tensor("float32", Float32Array.of(1), [1]),
      adds_samples: new Tensor("float32", Float32Array.of(1), [1]),
      display_size: new Tensor("int64", BigInt64Array.from([displayW, displayH], BigInt), [2]),
    };
    const sizes = {
      display_width: displayW, display_height: displayH, previous_width: w, previous_height: h,
      half_width: Math.ceil(displayW / 2), half_height: Math.ceil(displayH / 2),
      previous_blocks_across: Math.ceil(w / 4), previous_blocks_down: Math.ceil(h / 4),
      previous_phases: Math.floor((9 * displayW * displayH) / (w * h)) + 2,
    };
    const feeds = {};
    for (const { name } of this.contract.inputs) feeds[name] = inputs[name];
    for (const { name, shape } of this.contract.history) {
      const sides = shape.map((side) => sizes[side] ?? side), zeros = () => new Float32Array(sides.reduce((a, b) => a * b));
      feeds[name] = frame.reset || !this.history[name] ? new Tensor("float32", zeros(), sides) : this.history[name];
    }
    const wanted = ["image", ...this.contract.history.map(({ output }) => output)];
    const results = await this.session.run(feeds, wanted);
    for (const { name, output } of this.contract.history) this.history[name] = results[output];
    return results.image.data;
  }
}

/** @param {import("./exr.js").Plane[]} planes @returns {Float32Array} one after another */
function joined(planes) {
  const values = planes.map((plane) => asFloat(plane).values), whole = new Float32Array(planes.length * values[0].length);
  values.forEach((part, i) => whole.set(part, i * part.length));
  return whole;
}
