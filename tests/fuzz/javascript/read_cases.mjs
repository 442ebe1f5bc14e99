/**
 * Read files that may be damaged, one after another, with the readers of examples/web.
 *
 *   node read_cases.mjs KIND BASE CASES FIRST COUNT PEAK
 *
 * KIND: a key of READERS. BASE: folder of whole files; those that CASES has in a folder of the case's number replace
 * them. PEAK: bytes of memory that this process may ever have taken.
 *
 * A line of JSON before each case has its number; the line after it, what the reader said, or what it raised though
 * it must not: an error of another class than its own.
 */

import { createHash } from "node:crypto";
import { existsSync, readFileSync, readdirSync, statSync } from "node:fs";
import { join } from "node:path";
import { ExrError, readExr } from "../../../examples/web/page/exr.js";
import { ShotError, ShotFolder, readerOfFiles } from "../../../examples/web/page/shot_folder.js";
import { ExposureMeter } from "../../../examples/web/page/shot_source.js";
import { Upscaler, UpscalerError } from "../../../examples/web/supersampler.js";
import { fakeDevice } from "./fake_gpu.mjs";

const DISPLAY = [64, 36];
const RENDER_SIZES = [[32, 18], [40, 30], [32, 18]];

/** Return a digest of all values. */
async function readImages(files) {
  const digest = createHash("sha256");
  for (const [name, data] of files) {
    const { width, height, planes } = await readExr(await data.arrayBuffer(), name);
    for (const [channel, { values }] of planes) {
      if (values.length !== width * height) throw new Error(`${channel} has ${values.length} values`);
      digest.update(values);
    }
  }
  return digest.digest("hex");
}

async function readShot(files) {
  const shot = await ShotFolder.open(readerOfFiles(files));
  const meter = new ExposureMeter();
  for (const index of new Set([0, shot.length >> 1, shot.length - 1])) {
    const frame = await shot.frame(index);
    if (!(meter.read(frame) > 0)) throw new Error("an exposure is not positive");
    await frame.reference();
  }
}

async function readShaders(files) {
  const device = fakeDevice();
  const texture = (format, size) => device.createTexture({ format, size, usage: 12 });
  const source = async (name) => files.get(name)?.arrayBuffer() ?? { ok: false, status: 404 };
  const upscaler = await Upscaler.load(device, source, { displaySize: DISPLAY });
  const output = texture("rgba16float", DISPLAY);
  const encoder = device.createCommandEncoder();
  const encode = (size, reset) => {
    const [color, depth, motion] = ["rgba32float", "r32float", "rg32float"].map((format) => texture(format, size));
    upscaler.encode(encoder, { color, depth, motion }, output, { jitter: [0.1, 0], exposure: 1, reset });
  };
  const loaded = new Set([...device.held, "params"]);
  encode(RENDER_SIZES[0], true);
  upscaler.resize(DISPLAY);
  if (device.held.size > loaded.size) throw new Error(`${[...device.held]} outlive resize`);
  for (const reset of [false, true]) RENDER_SIZES.forEach((size) => encode(size, reset));
  const { buffers } = device.made;
  encode(RENDER_SIZES[0]);
  if (device.made.buffers > buffers) throw new Error("a step makes a buffer");
  upscaler.destroy();
}

const READERS = {
  images: [readImages, ExrError],
  shot: [readShot, ShotError, ExrError],
  shaders: [readShaders, UpscalerError],
};

/** Return the files below a folder as Blobs, by their paths. */
function filesOf(folder, prefix = "") {
  return new Map(
    readdirSync(folder).flatMap((name) => {
      const path = join(folder, name);
      if (statSync(path).isDirectory()) return [...filesOf(path, `${prefix}${name}/`)];
      return [[prefix + name, new Blob([readFileSync(path)])]];
    }),
  );
}

const say = (line) => process.stdout.write(`${JSON.stringify(line)}\n`);
/** The most memory that this process took. Its own: maxRSS is at least what its parent took when it was started. */
function peakBytes() {
  const own = existsSync("/proc/self/status") && /VmHWM:\s*(\d+)/.exec(readFileSync("/proc/self/status", "utf8"));
  return 1024 * (own ? Number(own[1]) : process.resourceUsage().maxRSS);
}

const [kind, base, cases, first, count, peak] = process.argv.slice(2);
const [read, ...own] = READERS[kind];
const whole = filesOf(base);
for (let number = Number(first); number < Number(count); number++) {
  const files = new Map([...whole, ...filesOf(join(cases, String(number)))]);
  say({ case: number });
  try {
    const digest = await read(files);
    say({ case: number, said: digest ? `read ${digest}` : "read" });
  } catch (error) {
    const text = `${error.name}: ${error.message}`;
    if (own.some((one) => error instanceof one)) say({ case: number, said: text });
    else say({ case: number, raised: `${text.slice(0, 300)} ${error.stack?.split("\n")[1] ?? ""}` });
  }
  const taken = peakBytes();
  if (taken > Number(peak)) {
    say({ case: number, raised: `took ${Math.round(taken / 2 ** 20)} MiB of memory` });
    process.exit(3); // the next case would be blamed for it
  }
}
