/**
 * The step by the CPU library, compiled to WebAssembly: sdk/native/include/supersampler.h.
 * @typedef {import("./shot_folder.js").ShotFrame} ShotFrame
 */

import { asFloat } from "./shot_source.js";

const LIBRARY = new URL("../cpu/supersampler.wasm", import.meta.url);
const ERROR_BYTES = 256; // ss_error
const NO_IMAGE = [0, 0, 0, 0, 0]; // ss_image: data, type, strides of rows, pixels and channels

export class CpuStep {
  /** @param {string} method @param {[number, number]} displaySize width and height @returns {Promise<CpuStep>} */
  static async load(method, displaySize) {
    let memory;
    const clock_time_get = (_clock, _precision, to) => {
      new DataView(memory.buffer).setBigUint64(to, BigInt(Math.round(1e6 * performance.now())), true);
      return 0;
    };
    const none = () => 52; // ENOSYS: the library only reads the clock
    const wasi = new Proxy({ clock_time_get }, { get: (functions, name) => functions[name] ?? none });
    const { instance } = await WebAssembly.instantiateStreaming(fetch(LIBRARY), { wasi_snapshot_preview1: wasi });
    memory = instance.exports.memory;
    instance.exports._initialize();
    return new CpuStep(instance.exports, method, displaySize);
  }

  /** @param {any} library its exports @param {string} method @param {[number, number]} displaySize */
  constructor(library, method, displaySize) {
    this.library = library;
    this.displaySize = displaySize;
    /** @type {Map<string, { at: number, bytes: number }>} memory by its use */ this.rooms = new Map();
    this.error = this.#room("error", ERROR_BYTES);
    const name = this.#put("name", new TextEncoder().encode(`${method}\0`)), made = this.#room("made", 4);
    this.#check(library.ss_model_create(name, 0, made, this.error));
    this.#check(library.ss_upscaler_create(this.#word(made), ...displaySize, made, this.error));
    this.upscaler = this.#word(made);
  }

  /**
   * @param {ShotFrame} frame @param {number} exposure
   * @returns {Float32Array} planes of red, green, blue at display size, linear, until the next step
   */
  step(frame, exposure) {
    const { library, displaySize } = this, [width, height] = frame.size;
    const images = [["color", frame.color], ["depth", [frame.depth]], ["motion", frame.motion]].map(([name, planes]) => this.#planes(name, planes, width));
    const whole = Int32Array.of(width, height, ...images.flat(), ...Array(6).fill(NO_IMAGE).flat());
    const preExposure = 1, addsSamples = 1;
    const numbers = Float32Array.of(...frame.jitter, exposure, preExposure), rest = [Int32Array.of(frame.reset ? 1 : 0), Float32Array.of(addsSamples)];
    const bytes = 12 * displaySize[0] * displaySize[1], image = this.#room("image", bytes);
    const outputs = Int32Array.of(...imageOf(image, ...displaySize), ...NO_IMAGE, ...NO_IMAGE, 0, 0, 0, 0);
    const given = this.#put("frame", joined([whole, numbers, ...rest])), wanted = this.#put("outputs", joined([outputs]));
    this.#check(library.ss_step(this.upscaler, given, wanted, this.error));
    return new Float32Array(library.memory.buffer, image, bytes / 4);
  }

  /** @param {string} name @param {import("./exr.js").Plane[]} planes @param {number} width @returns {number[]} an ss_image of them */
  #planes(name, planes, width) {
    const parts = planes.map((plane) => asFloat(plane).values);
    return imageOf(this.#put(name, joined(parts)), width, parts[0].length / width);
  }

  /** @returns {number} address of memory, kept for the next use of this name */
  #room(name, bytes) {
    const before = this.rooms.get(name);
    if (before?.bytes >= bytes) return before.at;
    if (before) this.library.free(before.at);
    const at = this.library.malloc(bytes);
    if (!at) throw new Error(`The CPU library has no memory for ${bytes} bytes.`);
    this.rooms.set(name, { at, bytes });
    return at;
  }

  /** @param {string} name @param {Uint8Array} bytes @returns {number} their address */
  #put(name, bytes) {
    const at = this.#room(name, bytes.length);
    new Uint8Array(this.library.memory.buffer, at, bytes.length).set(bytes);
    return at;
  }

  #word(at) {
    return new Uint32Array(this.library.memory.buffer, at, 1)[0];
  }

  /** @param {number} status @throws {Error} with the library's message */
  #check(status) {
    if (!status) return;
    const bytes = new Uint8Array(this.library.memory.buffer.slice(this.error, this.error + ERROR_BYTES));
    throw new Error(new TextDecoder().decode(bytes.subarray(0, bytes.indexOf(0))));
  }
}

/** @returns {number[]} the words of an ss_image of float32 planes */
const imageOf = (at, width, height) => [at, 0, 4 * width, 4, 4 * width * height];

/** @param {(Int32Array | Float32Array)[]} parts @returns {Uint8Array} their bytes, one after another */
function joined(parts) {
  const bytes = new Uint8Array(parts.reduce((sum, part) => sum + part.byteLength, 0));
  let at = 0;
  for (const part of parts) {
    bytes.set(new Uint8Array(part.buffer, part.byteOffset, part.byteLength), at);
    at += part.byteLength;
  }
  return bytes;
}
