/**
 * The folder that `supersampler export METHOD --target wgsl` wrote: reads it, checks it against a device, compiles its
 * shaders. supersampler.js is the interface.
 */

const FORMAT = "supersampler-shaders";
const VERSION = 3;
const MIN_BYTES = 16; // of a buffer
const COMPUTE = 4; // GPUShaderStage.COMPUTE
const UPDATE = "Update the browser or the driver.";
const EXPORT = "Export the folder again.";

const GBUFFERS = ["base_color", "normal", "display_base_color", "display_normal", "display_depth"];
const AOVS = Array.from({ length: 64 }, (_, i) => `aovs${i}`); // of four channels each
/** Names of the textures of a frame. */
export const INPUTS = ["color", "depth", "motion", "reactive", ...GBUFFERS.map((name) => `gbuffer_${name}`), ...AOVS];
/** Fields of params, with their numbers of values. */
const PARAMS = {
  render: 2,
  display: 2,
  previous: 2,
  jitter: 2,
  exposure: 1,
  adds_samples: 1,
  writes_aux: 1,
  pre_exposure: 1,
  has_reactive: 1,
  skips: 1,
};
/** Kinds of resources, by role. */
const ROLES = {
  params: ["uniform"],
  weights: ["uniform", "buffer"],
  history: ["buffer", "texture"],
  next: ["buffer", "texture"],
  work: ["buffer", "texture"],
  aux: ["buffer"],
  frame: ["texture"],
  image: ["texture"],
  aovs: ["texture"],
};
/** Kinds of bindings, by the kind of their resource. */
const BINDINGS = {
  uniform: ["uniform"],
  buffer: ["storage", "read-only-storage"],
  texture: ["texture", "uint-texture", "storage-texture"],
};
/** Bytes of a texel, by format. */
const TEXELS = { rgba32float: 16, rgba32uint: 16, rgba16float: 8, rg32float: 8, rg32uint: 8, r32uint: 4 };
const BASES = ["one", "render", "previous", "display", "signatures", "previous_signatures"];

// Limits of what a folder may state.
const JSON_BYTES = 1 << 20;
const SHADER_BYTES = 1 << 22;
const BUFFER_BYTES = 1 << 28; // for each pixel of its size
const PASSES = 256;
const RESOURCES = 256;
const PASS_BINDINGS = 64;
const GROUPS = 4; // WebGPU's default, and that of bindings
const GROUP_BINDINGS = 1000;
const TEXTS = 1024; // in a list
const TEXT = 4096; // characters
const FACTOR = 1 << 16; // of a size, or pixels of a tile
const RATIOS = [2 ** -4, 2 ** 4];
const PIXEL_BYTES = 1024; // of all resources together, for each pixel; beyond FIXED_BYTES
const FIXED_BYTES = 2 ** 29;

/** An error whose message states the value found, the value expected, and a remedy. */
export class UpscalerError extends Error {
  constructor(name, got, want, hint = "") {
    super(`${name} is ${got}; want ${want}. ${hint}`.trimEnd());
    this.name = "UpscalerError";
  }
}

/** Return the base sizes of upscaler.json, from the sizes of this frame, the previous frame and the image. */
export function basesOf(render, previous, display) {
  const signatures = ([width, height]) => {
    const phases = Math.floor((9 * display[0] * display[1]) / (width * height)) + 2;
    return [Math.ceil(width / 4), Math.ceil(height / 4) * phases];
  };
  const of = { signatures: signatures(render), previous_signatures: signatures(previous) };
  return { one: [1, 1], render, previous, display, ...of };
}

/** Return (width, height) of a size of upscaler.json. */
export function sizeOf({ of, divide, multiply }, sizes) {
  const [width, height] = sizes[of];
  return [Math.ceil(width / divide) * multiply[0], Math.ceil(height / divide) * multiply[1]];
}

export function bytesOf(described, width, height) {
  if (described.role === "aux") return MIN_BYTES; // it is not written
  return Math.max(Math.ceil((described.bytes * width * height) / 4) * 4, MIN_BYTES);
}

/**
 * Return whether display size over render size is in a range, up to the rounding of both to whole pixels; in a range from
 * 1 on, no frame is larger than the display.
 */
export function fitsRatio([low, high], render, display) {
  return [0, 1].every((axis) => {
    const min = (display[axis] - 1) / (render[axis] + 1);
    const max = render[axis] === 1 ? Infinity : (display[axis] + 1) / (render[axis] - 1);
    return min <= high && max >= low && display[axis] >= Math.min(low, 1) * render[axis];
  });
}

/** Return the body of a Response as an ArrayBuffer; null where it has more than `max` bytes. */
export async function bodyOf(response, max) {
  if (!response.body?.getReader) {
    const whole = await response.arrayBuffer();
    return whole.byteLength > max ? null : whole;
  }
  const stream = response.body.getReader();
  const parts = [];
  let bytes = 0;
  for (let part = await stream.read(); !part.done; part = await stream.read()) {
    bytes += part.value.length;
    if (bytes > max) {
      stream.cancel().catch(() => {});
      return null;
    }
    parts.push(part.value);
  }
  return new Blob(parts).arrayBuffer();
}

/** Return a function that reads a file of the folder, of at most `max` bytes, as "text" or "bytes". */
export function reader(source) {
  if (typeof source !== "function" && typeof source !== "string" && typeof source?.href !== "string") {
    const want = "the address of a folder, or a function that returns its files";
    throw new UpscalerError("source", shown(source), want, "Of a module's files: (name) => files[name].");
  }
  const folder = typeof source === "function" ? null : String(source).replace(/\/?$/, "/");
  const get = folder === null ? source : (name) => fetch(folder + name);
  return async (name, kind, max) => {
    const where = `${folder ?? ""}${name}`;
    let got, isPage;
    try {
      got = await get(name);
      isPage = got?.headers?.get("content-type")?.startsWith("text/html");
      if (got?.ok !== false && typeof got?.arrayBuffer === "function") got = await bodyOf(got, max);
    } catch (error) {
      throw new UpscalerError(where, `unreadable (${error.message})`, "a file of the exported folder");
    }
    if (got?.ok === false || isPage) {
      const hint = "Copy the whole folder to where the server finds it; its files lie side by side.";
      const answer = isPage ? "answered by the server with a page of HTML" : `HTTP ${got.status}`;
      throw new UpscalerError(where, answer, "a file of the exported folder", hint);
    }
    if (got === null || got?.byteLength > max || got?.length > max) {
      throw new UpscalerError(where, "larger", `at most ${max} bytes`, EXPORT);
    }
    if (typeof got === "string" && kind === "text") return got;
    if (!(got instanceof ArrayBuffer) && !ArrayBuffer.isView(got)) {
      throw new UpscalerError(where, shown(got), "a Response, an ArrayBuffer, a typed array or a string");
    }
    const [buffer, first] = ArrayBuffer.isView(got) ? [got.buffer, got.byteOffset] : [got, 0];
    const bytes = new Uint8Array(buffer, first, got.byteLength);
    return kind === "text" ? new TextDecoder().decode(bytes) : bytes;
  };
}

/** A value of a JSON file, with its place in it. A value that does not fit throws the error that `fail` makes. */
export class Field {
  /** `fail` takes the place, the value found, and the value expected. */
  constructor(place, value, fail) {
    this.place = place;
    this.value = value;
    this.fail = fail;
  }

  refuse(want) {
    throw this.fail(this.place, shown(this.value), want);
  }

  /** Return the value if it passes a test. */
  as(want, test) {
    return test(this.value) ? this.value : this.refuse(want);
  }

  object() {
    return this.as(
      "an object",
      (value) => typeof value === "object" && value !== null && !Array.isArray(value),
    );
  }

  /** Return a member of an object; its value is undefined if it is missing. */
  at(name) {
    const value = Object.hasOwn(this.object(), name) ? this.value[name] : undefined;
    return new Field(this.place ? `${this.place}.${name}` : name, value, this.fail);
  }

  /** Return the result of `read` for a member; `otherwise` if it is missing or null. */
  read(name, read, otherwise) {
    const member = this.at(name);
    return member.value === undefined || member.value === null ? otherwise : read(member);
  }

  items(min, max) {
    const isList = (value) => Array.isArray(value) && value.length >= min && value.length <= max;
    const items = this.as(`a list of ${min} to ${max} items`, isList);
    return items.map((one, index) => new Field(`${this.place}[${index}]`, one, this.fail));
  }

  /** Return the results of `read` for each of two items. */
  pair(read) {
    return this.items(2, 2).map(read);
  }

  number(min, max) {
    const isNumber = (value) => typeof value === "number" && value >= min && value <= max;
    return this.as(`a number from ${min} to ${max}`, isNumber);
  }

  whole(min, max) {
    const isWhole = (value) => Number.isInteger(value) && value >= min && value <= max;
    return this.as(`a whole number from ${min} to ${max}`, isWhole);
  }

  positive() {
    const isPositive = (value) =>
      typeof value === "number" && Math.fround(value) > 0 && Math.fround(value) < Infinity;
    return this.as("a number > 0", isPositive);
  }

  text(max = TEXT) {
    return this.as(
      `text of at most ${max} characters`,
      (value) => typeof value === "string" && value.length <= max,
    );
  }

  texts() {
    return this.items(0, TEXTS).map((one) => one.text());
  }

  oneOf(choices) {
    return this.as(choices.map(shown).join(" or ").slice(0, TEXT), (value) => choices.includes(value));
  }

  /** Return the name of a file beside this one. */
  file() {
    return this.as(
      "the name of a file in the folder",
      (value) => typeof value === "string" && /^\w[\w.-]{0,254}$/.test(value),
    );
  }
}

/** Return the names of the textures of AOVs that a folder blends. */
export function aovsOf(info) {
  return info.inputs.map((one) => one.name).filter((name) => AOVS.includes(name));
}

/** Return the content of a JSON file. */
export function parsedJson(text, fail) {
  try {
    return new Field("", JSON.parse(text), fail);
  } catch (error) {
    throw fail("", `no JSON (${error.message})`, "a file that was written whole");
  }
}

/** Read and check upscaler.json. */
export async function readInfo(read) {
  return checkedInfo(await read("upscaler.json", "text", JSON_BYTES));
}

/** Return the content of upscaler.json after checking that all names exist and all numbers are in range. */
export function checkedInfo(text) {
  const file = parsedJson(
    text,
    (place, got, want) => new UpscalerError(`upscaler.json${place && `: ${place}`}`, got, want, EXPORT),
  );
  const info = file.object();
  if (info.format !== FORMAT || info.version !== VERSION) {
    const got = `${shown(info.format)} version ${shown(info.version)}`;
    throw new UpscalerError("upscaler.json", got, `${FORMAT} version ${VERSION}`, EXPORT);
  }
  if (info.target !== "wgsl" || info.images !== "textures") {
    const hint = "`supersampler export METHOD --target wgsl -o FOLDER` writes it.";
    throw new UpscalerError(
      "upscaler.json",
      `for ${shown(info.target)} and ${shown(info.images)}`,
      "wgsl and textures",
      hint,
    );
  }
  checkFacts(file);
  const resources = checkedResources(file);
  checkHistory(file, resources);
  file
    .at("passes")
    .items(1, PASSES)
    .forEach((pass) => checkPass(pass, resources));
  return info;
}

function checkFacts(file) {
  for (const name of ["method", "licence"]) file.at(name).text();
  file.at("precision").oneOf(["fp32", "int8"]);
  file.at("attributions").texts();
  const [low, high] = file.at("ratios").pair((ratio) => ratio.number(...RATIOS));
  file.at("ratios").as("the smaller ratio first", () => low <= high);
  const requires = file.at("requires");
  requires.at("features").texts();
  requires.at("wgsl_language_features").texts();
  const limits = requires.at("limits");
  for (const name of Object.keys(limits.object())) limits.at(name).number(0, Number.MAX_VALUE);
  for (const input of file.at("inputs").items(1, INPUTS.length)) {
    input.at("unit").text();
    input.at("range").pair((end) => end.number(-Number.MAX_VALUE, Number.MAX_VALUE));
    input.at("formats").texts();
  }
  const params = file.at("params");
  const bytes = params
    .at("bytes")
    .as("a multiple of 16 up to 1024", (value) => Number.isInteger(value / 16) && value > 0 && value <= 1024);
  for (const field of params.at("fields").items(0, Object.keys(PARAMS).length)) {
    const count = PARAMS[field.at("name").oneOf(Object.keys(PARAMS))];
    field.at("count").oneOf([count]);
    field
      .at("offset")
      .as(
        "a multiple of 4 within params",
        (value) => Number.isInteger(value / 4) && value >= 0 && value + 4 * count <= bytes,
      );
  }
}

/** Return the resources by name. */
function checkedResources(file) {
  const inputs = file
    .at("inputs")
    .items(1, INPUTS.length)
    .map((input) => input.at("name").oneOf(INPUTS));
  file
    .at("inputs")
    .as(
      "a list with color, without one twice",
      () => inputs.includes("color") && new Set(inputs).size === inputs.length,
    );
  const aovs = inputs.filter((name) => AOVS.includes(name));
  const names = { params: ["params"], frame: inputs.map((name) => `frame_${name}`), image: ["image"], aovs };
  const resources = new Map();
  for (const one of file.at("resources").items(1, RESOURCES)) {
    const name = one.at("name").text();
    const role = one.at("role").oneOf(Object.keys(ROLES));
    const kind = one.at("kind").oneOf(ROLES[role]);
    one.at("name").oneOf(names[role] ?? [name]);
    one.at("name").as("a name of one resource", () => !resources.has(name));
    checkSize(one.at("size"));
    const formats = { frame: [undefined], image: ["rgba16float"], aovs: ["rgba16float"] };
    if (kind === "texture") one.at("format").oneOf(formats[role] ?? Object.keys(TEXELS));
    else one.at("bytes").whole(0, BUFFER_BYTES);
    if (role === "weights") one.at("file").file();
    else one.at("file").oneOf([undefined]);
    if (role === "params") one.at("bytes").oneOf([file.at("params").at("bytes").value]);
    if (role === "weights") one.at("bytes").as("a multiple of 4", (bytes) => bytes % 4 === 0);
    if (role === "params" || role === "weights") {
      one.at("size").as("1x1", (size) => size.of === "one" && String(size.multiply) === "1,1");
    }
    resources.set(name, one.value);
  }
  file.at("resources").as("a list with params", () => resources.get("params")?.role === "params");
  const isWhole = aovs.every((name) => resources.get(name)?.role === "aovs");
  file.at("resources").as(`a list with ${aovs.join(", ")}`.slice(0, TEXT), () => isWhole);
  return resources;
}

function checkSize(size) {
  size.at("of").oneOf(BASES);
  size.at("divide").whole(1, FACTOR);
  size.at("multiply").pair((factor) => factor.whole(1, FACTOR));
}

/** Check that each pair has two resources of one kind, and that all resources of their roles are in a pair. */
function checkHistory(file, resources) {
  const pairs = file.at("history").at("pairs");
  const single = new Set(
    [...resources.values()]
      .filter(({ role }) => role === "history" || role === "next")
      .map(({ name }) => name),
  );
  for (const pair of pairs.items(0, RESOURCES)) {
    const both = pair.items(2, 2);
    for (const [index, role] of ["history", "next"].entries()) {
      both[index].as(
        `a resource of the role ${role}, in one pair`,
        (name) => resources.get(name)?.role === role && single.delete(name),
      );
    }
    const [before, after] = both.map((one) => resources.get(one.value));
    pair.as("two of a kind", () => ["kind", "format", "bytes"].every((key) => before[key] === after[key]));
  }
  pairs.as(`a list with ${[...single].join(", ")}`.slice(0, TEXT), () => single.size === 0);
}

function checkPass(pass, resources) {
  pass.at("name").text();
  pass.at("file").file();
  pass.at("entry_point").text();
  checkSize(pass.at("covers"));
  pass.at("tile").pair((side) => side.whole(1, FACTOR));
  const places = new Set();
  const groups = new Set();
  for (const one of pass.at("bindings").items(0, PASS_BINDINGS)) {
    const group = one.at("group").whole(0, GROUPS - 1);
    const place = `${group}/${one.at("binding").whole(0, GROUP_BINDINGS - 1)}`;
    one.as("a binding of its own", () => !places.has(place));
    places.add(place);
    groups.add(group);
    const resource = resources.get(
      one.at("resource").as("a name among resources", (name) => resources.has(name)),
    );
    const kind = one.at("kind").oneOf(BINDINGS[resource.kind]);
    if (kind === "storage-texture") {
      one
        .at("format")
        .as("that of the resource", (format) => format !== undefined && format === resource.format);
    }
  }
  pass.at("bindings").as("a list of groups without a gap", () => Math.max(-1, ...groups) === groups.size - 1);
}

export function checkDevice(device, info) {
  if (!device?.createShaderModule) throw new UpscalerError("device", shown(device), "a GPUDevice");
  const lacking = Object.entries(info.requires.limits).filter(([name, min]) => device.limits[name] < min);
  lacking.push(
    ...info.requires.features.filter((name) => !device.features.has(name)).map((name) => [name, ""]),
  );
  const known = globalThis.navigator?.gpu?.wgslLanguageFeatures;
  if (known) {
    const wanted = info.requires.wgsl_language_features;
    lacking.push(...wanted.filter((name) => !known.has(name)).map((name) => [`WGSL's ${name}`, ""]));
  }
  if (lacking.length) {
    const want = lacking.map(([name, min]) => `${name} ${min}`.trimEnd()).join(", ");
    throw new UpscalerError("device", `below that, on ${adapterText(device)}`, want, UPDATE);
  }
}

/**
 * Throw where a resource or a pass is above the device's limits. `name` is what the size in `sizes` with the key `of`
 * is called.
 */
export function checkMemory(device, info, sizes, name, of) {
  const { maxStorageBufferBindingSize, maxTextureDimension2D, maxComputeWorkgroupsPerDimension } =
    device.limits;
  const refuse = (got, want, hint) => {
    throw new UpscalerError(name, `${sizes[of].join("x")}${got}`, want, hint);
  };
  let total = 0;
  for (const one of info.resources) {
    const [width, height] = sizeOf(one.size, sizes);
    const bytes =
      one.kind === "texture" ? (TEXELS[one.format] ?? 0) * width * height : bytesOf(one, width, height);
    if (one.kind !== "texture" && bytes > maxStorageBufferBindingSize) {
      const got = `, which needs ${bytes} bytes in one binding (${one.name})`;
      refuse(got, `at most ${maxStorageBufferBindingSize}`, "Request a device with larger limits.");
    }
    if (one.kind === "texture" && Math.max(width, height) > maxTextureDimension2D) {
      refuse("", `at most ${maxTextureDimension2D} in one direction`);
    }
    total += bytes;
  }
  const max =
    FIXED_BYTES + PIXEL_BYTES * BASES.reduce((sum, base) => sum + sizes[base][0] * sizes[base][1], 0);
  if (total > max) refuse(`, which needs ${total} bytes`, `at most ${max}`, EXPORT);
  for (const pass of info.passes) {
    const groups = sizeOf(pass.covers, sizes).map((side, axis) => Math.ceil(side / pass.tile[axis]));
    if (Math.max(...groups) > maxComputeWorkgroupsPerDimension) {
      refuse(
        `, which needs ${groups.join("x")} workgroups (${pass.name})`,
        `at most ${maxComputeWorkgroupsPerDimension} in one direction`,
      );
    }
  }
}

/** Compile a pass. */
export async function compiled(device, described, read) {
  const code = await read(described.file, "text", SHADER_BYTES);
  device.pushErrorScope("validation"); // compilation messages have the errors
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
  let text;
  try {
    text = JSON.stringify(value) ?? String(value);
  } catch {
    return "a value that JSON cannot hold"; // nested too deeply, or a BigInt
  }
  return text.length > 80 ? `${text.slice(0, 80)}...` : text;
}
