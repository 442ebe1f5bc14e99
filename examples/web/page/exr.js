/**
 * Reads OpenEXR files as shot folders have them: one part, scanlines, half and float channels, without
 * compression or with ZIP or ZIPS.
 * @typedef {{ type: "half", values: Uint16Array } | { type: "float", values: Float32Array }} Plane
 * @typedef {{ width: number, height: number, planes: Map<string, Plane> }} Image
 */

const MAGIC = 20000630;
const TILED = 0x200, DEEP = 0x800, MULTIPART = 0x1000;
const COMPRESSIONS = ["none", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB"];
/** Rows of a block, by the number of its compression. @type {Record<number, number>} */
const BLOCK_ROWS = { 0: 1, 2: 1, 3: 16 };
const HALF = 1, FLOAT = 2;

/** A file that cannot be read; the message names it. */
export class ExrError extends Error {
  /** @param {string} name of the file @param {string} problem */
  constructor(name, problem) {
    super(`${name}: ${problem}.`);
    this.name = "ExrError";
  }
}

/**
 * @param {ArrayBuffer} buffer the whole file @param {string} name of the file, for messages
 * @returns {Promise<Image>} planes of all channels, row 0 on top; half values as their 16 bits
 * @throws {ExrError} it is damaged, or of a kind that is not read
 */
export async function readExr(buffer, name) {
  try {
    return await decode(new DataView(buffer), name);
  } catch (error) {
    if (error instanceof ExrError) throw error;
    throw new ExrError(name, `is damaged or cut off (${error.message})`); // RangeError of a read past the end, TypeError of inflation
  }
}

/** @param {DataView} view @param {string} name @returns {Promise<Image>} */
async function decode(view, name) {
  if (view.byteLength < 8 || view.getUint32(0, true) !== MAGIC) throw new ExrError(name, "is no OpenEXR file");
  const flags = view.getUint32(4, true);
  if (flags & (TILED | DEEP | MULTIPART)) {
    throw new ExrError(name, "has tiles, deep pixels or several parts; this page reads scanlines of one part");
  }
  const { attributes, end } = readAttributes(view);
  const { width, height } = readSize(attributes, name);
  const channels = readChannels(attributes.get("channels"), name);
  const compression = attributes.get("compression").getUint8(0), rows = BLOCK_ROWS[compression];
  if (rows === undefined) {
    const written = COMPRESSIONS[compression] ?? `of kind ${compression}`;
    throw new ExrError(name, `has compression ${written}; this page reads ZIP, ZIPS and none. Copy the shot with supersampler import`);
  }
  const planes = new Map(channels.map(({ channel, type }) => [
    channel, type === HALF ? { type: "half", values: new Uint16Array(width * height) } : { type: "float", values: new Float32Array(width * height) },
  ]));
  const rowBytes = channels.reduce((sum, { type }) => sum + width * 2 * type, 0);
  const blocks = Array.from({ length: Math.ceil(height / rows) }, (_, block) => block * rows);
  await Promise.all(blocks.map(async (top, block) => {
    const at = Number(view.getBigUint64(end + 8 * block, true));
    const packed = new Uint8Array(view.buffer, view.byteOffset + at + 8, view.getInt32(at + 4, true));
    const count = Math.min(rows, height - top);
    const bytes = packed.length === rowBytes * count ? packed : unfiltered(await inflate(packed));
    if (bytes.length !== rowBytes * count) throw new ExrError(name, `is damaged: rows from ${top} on have ${bytes.length} bytes`);
    copyRows(new DataView(bytes.buffer, bytes.byteOffset, bytes.length), planes, width, top, count);
  }));
  return { width, height, planes };
}

/** @param {DataView} view @returns {{ attributes: Map<string, DataView>, end: number }} */
function readAttributes(view) {
  const attributes = new Map();
  let at = 8;
  const text = () => {
    const [found, next] = textAt(view, at);
    at = next;
    return found;
  };
  for (let attribute = text(); attribute; attribute = text()) {
    text(); // its type
    const size = view.getInt32(at, true);
    attributes.set(attribute, new DataView(view.buffer, view.byteOffset + at + 4, size));
    at += 4 + size;
  }
  return { attributes, end: at };
}

/** @param {DataView} view @param {number} at @returns {[string, number]} text up to a zero, and what follows */
function textAt(view, at) {
  let found = "";
  for (let code = view.getUint8(at++); code; code = view.getUint8(at++)) found += String.fromCharCode(code);
  return [found, at];
}

/** @param {Map<string, DataView>} attributes @param {string} name */
function readSize(attributes, name) {
  const box = (key) => [0, 4, 8, 12].map((at) => attributes.get(key).getInt32(at, true));
  const data = box("dataWindow"), display = box("displayWindow");
  if (String(data) !== String(display)) {
    throw new ExrError(name, `has a data window of ${data} in a display window of ${display}; this page reads whole images`);
  }
  return { width: data[2] - data[0] + 1, height: data[3] - data[1] + 1 };
}

/** @param {DataView} view @param {string} name @returns {{ channel: string, type: number }[]} in the file's order */
function readChannels(view, name) {
  const channels = [];
  for (let [channel, at] = textAt(view, 0); channel; [channel, at] = textAt(view, at)) {
    const type = view.getInt32(at, true);
    const sampled = view.getInt32(at + 8, true) * view.getInt32(at + 12, true);
    if ((type !== HALF && type !== FLOAT) || sampled !== 1) {
      throw new ExrError(name, `channel ${channel} is of whole numbers or subsampled; want half or float`);
    }
    channels.push({ channel, type });
    at += 16;
  }
  return channels;
}

/** @param {Uint8Array} packed by zlib @returns {Promise<Uint8Array>} */
async function inflate(packed) {
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * Undoes what ZIP does before it packs: differences of neighbours, and even before odd bytes.
 * @param {Uint8Array} bytes changed @returns {Uint8Array}
 */
function unfiltered(bytes) {
  for (let i = 1; i < bytes.length; i++) bytes[i] += bytes[i - 1] - 128;
  const merged = new Uint8Array(bytes.length), half = (bytes.length + 1) >> 1;
  for (let i = 0; i < bytes.length; i++) merged[i] = bytes[(i >> 1) + (i & 1 ? half : 0)];
  return merged;
}

/** @param {DataView} rows @param {Map<string, Plane>} planes @param {number} width @param {number} top @param {number} count */
function copyRows(rows, planes, width, top, count) {
  let at = 0;
  for (let row = top; row < top + count; row++) {
    for (const { type, values } of planes.values()) {
      if (type === "half") for (let x = 0; x < width; x++, at += 2) values[row * width + x] = rows.getUint16(at, true);
      else for (let x = 0; x < width; x++, at += 4) values[row * width + x] = rows.getFloat32(at, true);
    }
  }
}
