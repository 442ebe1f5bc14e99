/**
 * The folder that `supersampler export METHOD --target wgsl` wrote: reads it, checks it against a device, compiles its
 * shaders. supersampler.js is the interface.
 */

const FORMAT = "supersampler-shaders";
const VERSION = 1;
const LEAST_BYTES = 16; // of a buffer
const COMPUTE = 4; // GPUShaderStage.COMPUTE
const UPDATE = "Update the browser or the driver.";

/** Something is not as it must be; the message says what came, what was wanted, and what to do. */
export class UpscalerError extends Error {
  constructor(name, got, want, hint = "") {
    super(`${name} is ${got}; want ${want}. ${hint}`.trimEnd());
    this.name = "UpscalerError";
  }
}

/** Return (width, height) of a size of upscaler.json. */
export function sizeOf({ of, divide, multiply }, sizes) {
  const [width, height] = sizes[of];
  return [Math.ceil(width / divide) * multiply[0], Math.ceil(height / divide) * multiply[1]];
}

export function bytesOf(described, width, height) {
  if (described.role === "aux") return LEAST_BYTES; // it is not written
  return Math.max(Math.ceil((described.bytes * width * height) / 4) * 4, LEAST_BYTES);
}

/** Return a function that reads a file of the folder as "text" or "bytes". */
export function reader(source) {
  const folder = typeof source === "function" ? null : String(source).replace(/\/?$/, "/");
  const get = folder === null ? source : (name) => fetch(folder + name);
  return async (name, kind) => {
    const where = `${folder ?? ""}${name}`;
    let got;
    try {
      got = await get(name);
    } catch (error) {
      throw new UpscalerError(where, `unreadable (${error.message})`, "a file of the exported folder");
    }
    if (got?.ok === false) {
      const hint = "Copy the whole folder; its files lie side by side.";
      throw new UpscalerError(where, `HTTP ${got.status}`, "a file of the exported folder", hint);
    }
    if (typeof got?.arrayBuffer === "function") got = await got.arrayBuffer();
    if (typeof got === "string" && kind === "text") return got;
    if (!(got instanceof ArrayBuffer) && !ArrayBuffer.isView(got)) {
      throw new UpscalerError(where, shown(got), "a Response, an ArrayBuffer, a typed array or a string");
    }
    const [buffer, first] = ArrayBuffer.isView(got) ? [got.buffer, got.byteOffset] : [got, 0];
    const bytes = new Uint8Array(buffer, first, got.byteLength);
    return kind === "text" ? new TextDecoder().decode(bytes) : bytes;
  };
}

export function checkedInfo(text) {
  let info;
  try {
    info = JSON.parse(text);
  } catch (error) {
    throw new UpscalerError(
      "upscaler.json",
      `no JSON (${error.message})`,
      "a file that `supersampler export` wrote",
    );
  }
  if (info?.format !== FORMAT || info.version !== VERSION) {
    const got = `${shown(info?.format)} version ${shown(info?.version)}`;
    throw new UpscalerError("upscaler.json", got, `${FORMAT} version ${VERSION}`, "Export the folder again.");
  }
  if (info.target !== "wgsl" || info.images !== "textures") {
    const hint = "`supersampler export METHOD --target wgsl -o FOLDER` writes it.";
    throw new UpscalerError(
      "upscaler.json",
      `for ${info.target} and ${info.images}`,
      "wgsl and textures",
      hint,
    );
  }
  return info;
}

export function checkDevice(device, info) {
  const lacking = Object.entries(info.requires.limits).filter(([name, least]) => device.limits[name] < least);
  lacking.push(
    ...info.requires.features.filter((name) => !device.features.has(name)).map((name) => [name, ""]),
  );
  const known = globalThis.navigator?.gpu?.wgslLanguageFeatures;
  if (known) {
    const wanted = info.requires.wgsl_language_features;
    lacking.push(...wanted.filter((name) => !known.has(name)).map((name) => [`WGSL's ${name}`, ""]));
  }
  if (lacking.length) {
    const want = lacking.map(([name, least]) => `${name} ${least}`.trimEnd()).join(", ");
    throw new UpscalerError("device", `below that, on ${adapterText(device)}`, want, UPDATE);
  }
}

/** Throw where a buffer or texture of the display's size is above the device's limits. */
export function checkMemory(device, info, display) {
  const size = { one: [1, 1], render: [1, 1], previous: [1, 1], display };
  for (const one of info.resources) {
    const [width, height] = sizeOf(one.size, size);
    const most = device.limits.maxStorageBufferBindingSize;
    if (one.kind === "buffer" && bytesOf(one, width, height) > most) {
      const got = `${display.join("x")}, which needs ${bytesOf(one, width, height)} bytes in one binding (${one.name})`;
      throw new UpscalerError("displaySize", got, `at most ${most}`, "Request a device with larger limits.");
    }
    if (one.kind === "texture" && Math.max(width, height) > device.limits.maxTextureDimension2D) {
      const want = `at most ${device.limits.maxTextureDimension2D} in one direction`;
      throw new UpscalerError("displaySize", display.join("x"), want);
    }
  }
}

/** Compile a pass. */
export async function compiled(device, described, code) {
  device.pushErrorScope("validation"); // messages have the errors
  const module = device.createShaderModule({ label: described.name, code });
  device.popErrorScope().catch(() => {}); // rejected where the device is lost
  const { messages } = await module.getCompilationInfo();
  const errors = messages.filter((one) => one.type === "error");
  const texts = errors.map((one) => `${described.file}:${one.lineNum}:${one.linePos} ${one.message}`);
  if (texts.length) throw notCompiled(device, described, texts.join("; "));
  const numbers = [...new Set(described.bindings.map((one) => one.group))].sort();
  const groups = numbers.map((number) => {
    const bindings = described.bindings.filter((one) => one.group === number);
    const layout = device.createBindGroupLayout({
      label: described.name,
      entries: bindings.map(layoutEntry),
    });
    return { bindings, layout };
  });
  try {
    const pipeline = await device.createComputePipelineAsync({
      label: described.name,
      layout: device.createPipelineLayout({ bindGroupLayouts: groups.map((one) => one.layout) }),
      compute: { module, entryPoint: described.entry_point },
    });
    return { ...described, pipeline, groups, bindGroups: new Map() };
  } catch (error) {
    throw notCompiled(device, described, error.message);
  }
}

function notCompiled(device, described, text) {
  const want = "a shader that compiles";
  const got = `refused by ${adapterText(device)} (${text.slice(0, 600)})`;
  return new UpscalerError(described.file, got, want, UPDATE);
}

function layoutEntry({ binding, kind, format }) {
  const entry = { binding, visibility: COMPUTE };
  if (kind === "storage-texture") entry.storageTexture = { access: "write-only", format };
  else if (kind === "texture") entry.texture = { sampleType: "unfilterable-float" };
  else if (kind === "uint-texture") entry.texture = { sampleType: "uint" };
  else entry.buffer = { type: kind };
  return entry;
}

function adapterText(device) {
  const { vendor, architecture, device: name, description } = device.adapterInfo ?? {};
  return [description, name, architecture, vendor].filter(Boolean).join(", ") || "an adapter without a name";
}

export function shown(value) {
  if (typeof value === "function" || value === undefined) return typeof value;
  const text = JSON.stringify(value) ?? String(value);
  return text.length > 80 ? `${text.slice(0, 80)}...` : text;
}
