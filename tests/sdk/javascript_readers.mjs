/** Checks of the readers of examples/web with servers, folders and sizes. Writes {promise: true, or a description of the failure} as JSON. */

import { createServer } from "node:http";
import {
  ShotError,
  ShotFolder,
  droppedFiles,
  readerOfFiles,
  readerOfUrl,
} from "../../examples/web/page/shot_folder.js";
import { Upscaler, UpscalerError, haltonJitter } from "../../examples/web/supersampler.js";
import { checkDevice, checkedInfo, fitsRatio, reader } from "../../examples/web/supersampler_folder.js";

const found = {};

/** Whether a call throws an error of this class with this text. */
async function refuses(kind, text, call) {
  try {
    await call();
  } catch (error) {
    return (error instanceof kind && error.message.includes(text)) || `${error.name}: ${error.message}`;
  }
  return "nothing was thrown";
}

// --- ratios: as check_ratio in sdk/supersampler/conventions/jitter.py ---

const fits = (render, display) => fitsRatio([1, 3], [render, 100], [display, 200]);
found["a ratio in the range fits"] = fits(100, 200);
found["a ratio of rounded sizes fits"] = fits(107, 320) && fits(33, 100) && fits(213, 213);
found["a larger ratio does not fit"] = !fits(100, 400);
found["a smaller ratio does not fit"] = !fits(100, 50) && !fits(213, 212);
found["one pixel does not fit any display"] = !fits(1, 1000) && !fitsRatio([1, 3], [1, 1], [1920, 1080]);
found["one pixel fits the same"] = fits(1, 1) && fits(1, 3);

// --- dropped folders ---

const file = (name) => ({ name, isDirectory: false, file: (resolve) => resolve(new Blob([name])) });
const folder = (name, entries) => ({
  name,
  isDirectory: true,
  createReader() {
    const rest = entries();
    return { readEntries: (resolve) => resolve(rest.splice(0, 100)) };
  },
});
const drop = (entry) => droppedFiles({ items: [{ webkitGetAsEntry: () => entry }] });
const many = (count) => Array.from({ length: count }, (_, index) => file(`${index}`));
const files = await drop(folder("shot", () => [file("a"), folder("b", () => [file("c"), ...many(250)])]));
found["files of folders in folders are found"] = files.size === 252 && files.has("b/c");
const endless = (name) => folder(name, () => [endless("a")]);
found["a folder in itself"] = await refuses(ShotError, "in more than 16 others", () => drop(endless("a")));
const wide = folder("wide", () => many(200_000));
found["a folder of very many files"] = await refuses(ShotError, "wide has more than 131072 files", () =>
  drop(wide),
);
const failing = {
  name: "x",
  isDirectory: true,
  createReader: () => ({ readEntries: (_, reject) => reject(new Error("gone")) }),
};
found["a folder that cannot be read"] = await refuses(ShotError, "x cannot be read: gone", () =>
  drop(failing),
);
const sized = (size) =>
  readerOfFiles(new Map([["a", { size, arrayBuffer: async () => new ArrayBuffer(0) }]]))("a", 100);
found["a file beyond the limit is not read"] = await refuses(ShotError, "a is larger", () => sized(101));
found["a file at the limit is read"] = (await sized(100)).byteLength === 0;

// --- servers ---

const asked = [];
const server = createServer((request, response) => {
  asked.push(request.url);
  if (request.url.endsWith("/endless")) {
    const more = () => response.write(Buffer.alloc(1 << 16), more);
    more();
    response.on("error", () => {});
  } else response.writeHead(200, /page/.test(request.url) ? { "content-type": "text/html" } : {}).end("12345");
});
await new Promise((listening) => server.listen(0, "127.0.0.1", listening));
const address = `http://127.0.0.1:${server.address().port}`;
const read = readerOfUrl(new URL(`${address}/shot/`));
for (const name of ["a b/0.exr", "%2e%2e/x", "a?b#c"]) await read(name, 100);
found["names are encoded in addresses"] =
  String(asked) === "/shot/a%20b/0.exr,/shot/%252e%252e/x,/shot/a%3Fb%23c" || asked;
found["a file of a server beyond the limit"] = await refuses(ShotError, "a is larger", () => read("a", 4));
found["a file of a server without end"] = await refuses(ShotError, "endless is larger", () =>
  read("endless", 1 << 20),
);
const shaders = reader(`${address}/shaders`);
found["a shader without end"] = await refuses(UpscalerError, "at most 1048576 bytes", () =>
  shaders("endless", "text", 1 << 20),
);
found["a page of HTML in place of a file"] = await refuses(UpscalerError, "answered by the server with a page of HTML", () =>
  shaders("page.wgsl", "text", 100),
);
found["a shader is read"] = (await shaders("a.wgsl", "text", 100)) === "12345";
asked.length = 0;
const names = (name) => async () =>
  new TextEncoder().encode(
    JSON.stringify({
      version: 1,
      name: "x",
      render_size: [8, 8],
      frames: [{ file: name, jitter: [0, 0] }],
    }),
  ).buffer;
const evil = async () => (await ShotFolder.open(names(`//${address.slice(7)}/x`))).frame(0);
found["a shot that names another host"] = await refuses(ShotError, "frames[0].file is", evil);
found["asks no host"] = asked.length === 0 || asked;
server.closeAllConnections?.();
server.close();

// --- values that callers and files have ---

for (const [name, text] of Object.entries({
  null: "null",
  list: "[]",
  text: '"x"',
  depth: `{"format": ${"[".repeat(1e5)}${"]".repeat(1e5)}}`,
})) {
  found[`upscaler.json that is ${name}`] = await refuses(UpscalerError, "upscaler.json is", () =>
    checkedInfo(text),
  );
}
found["an upscaler without a device"] = await refuses(UpscalerError, "device is null; want a GPUDevice", () =>
  checkDevice(null, {}),
);
found["a source that gives too much"] = await refuses(UpscalerError, "larger", () =>
  Upscaler.load({}, async () => new Uint8Array(2 << 20), {}),
);
for (const [text, call] of [
  ["source is undefined; want the address of a folder", () => Upscaler.load({}, undefined, {})],
  ['source is {"upscaler.json":"{}"}; want the address', () => Upscaler.load({}, { "upscaler.json": "{}" }, {})],
  ["options.size is a name that is not known; want one of displaySize", () => Upscaler.load({}, "a", { size: [1, 1] })],
  ["index is -1; want the number of a frame", () => haltonJitter(-1, 2)],
  ["ratio is undefined; want display size / render size", () => haltonJitter(0)],
  ["ratio is null; want display size / render size", () => haltonJitter(0, Infinity)],
]) {
  found[text] = await refuses(UpscalerError, text, call);
}
found["a frame larger than the image has a jitter"] = String(haltonJitter(5, 0.2)) === String(haltonJitter(0, 1));
process.stdout.write(JSON.stringify(found));
process.exit(0);
