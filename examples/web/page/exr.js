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
const NO_COMPRESSION = 0;
const HALF = 1, FLOAT = 2;

const IMAGE_SIDE = 1 << 15, IMAGE_PIXELS = 1 << 27, CHANNELS = 4096; // as sdk/supersampler/io/files.py has them
const PLANE_BYTES = 2 ** 30; // of all planes: a page has less memory than a process
const ATTRIBUTES = 1024, NAME_BYTES = 255;
const EXPANSION = 1100; // zlib makes at most 1032 bytes of one
const AT_ONCE = 4; // blocks that are inflated at the same time
const INPUT_BYTES = 1 << 14; // inflated at once: browsers keep all that comes of them, a thousand times as much

/** A file that cannot be read; the message names it. */
export class ExrError extends Error {
  /** @param {string} name of the file @param {string} problem */
  constructor(name, problem) {
    super(`${name}: ${problem}.`);
    this.name = "ExrError";
  }
}

/** @param {string} name of the file @param {string} reason @returns {ExrError} */
const damaged = (name, reason) => new ExrError(name, `is damaged or cut off (${reason})`);

/** Sizes of images that are read, in words. */
export const IMAGE_SIZE = `1 to ${IMAGE_SIDE} pixels a side and at most ${IMAGE_PIXELS}`;

/** @param {number} width @param {number} height @returns {boolean} whether images of this size are read */
export function isImageSize(width, height) {
  return [width, height].every((side) => Number.isInteger(side) && side >= 1 && side <= IMAGE_SIDE) && width * height <= IMAGE_PIXELS;
}

/**
 * @param {ArrayBuffer} buffer the whole file @param {string} name of the file, for messages
 * @param {(header: { width: number, height: number, channels: string[] }) => void} [check] called before pixels
 *   are read; what it throws is thrown
 * @returns {Promise<Image>} planes of all channels, row 0 on top; half values as their 16 bits
 * @throws {ExrError} it is damaged, beyond the limits, or of a kind that is not read
 */
export async function readExr(buffer, name, check = () => {}) {
  try {
    const { width, height, channels, blocks } = readHeader(new DataView(buffer), name);
    check({ width, height, channels: channels.map(({ channel }) => channel) });
    const planes = new Map(channels.map(({ channel, type }) => [
      channel, type === HALF ? { type: "half", values: new Uint16Array(width * height) } : { type: "float", values: new Float32Array(width * height) },
    ]));
    const read = async ({ at, size, bytes, top, count }) => {
      const packed = new Uint8Array(buffer, at, size);
      const rows = size === bytes ? packed : unfiltered(await inflate(packed, bytes, name));
      copyRows(new DataView(rows.buffer, rows.byteOffset, bytes), planes, width, top, count);
    };
    for (let i = 0; i < blocks.length; i += AT_ONCE) await Promise.all(blocks.slice(i, i + AT_ONCE).map(read));
    return { width, height, planes };
  } catch (error) {
    throw error instanceof RangeError ? damaged(name, error.message) : error; // a read past the end, or no memory for the planes
  }
}

/**
 * @typedef {{ at: number, size: number, bytes: number, top: number, count: number }} Block rows from `top` on: `size`
 *   bytes of the file, which become `bytes`
 * @param {DataView} view @param {string} name
 * @returns {{ width: number, height: number, channels: { channel: string, type: number }[], blocks: Block[] }}
 */
function readHeader(view, name) {
  if (view.byteLength < 8 || view.getUint32(0, true) !== MAGIC) throw new ExrError(name, "is no OpenEXR file");
  const flags = view.getUint32(4, true);
  if (flags & (TILED | DEEP | MULTIPART)) {
    throw new ExrError(name, "has tiles, deep pixels or several parts; this page reads scanlines of one part");
  }
  const { attributes, end } = readAttributes(view, name);
  const attribute = (key) => {
    if (!attributes.has(key)) throw damaged(name, `it has no ${key}`);
    return attributes.get(key);
  };
  const [data, display] = ["dataWindow", "displayWindow"].map((key) => [0, 4, 8, 12].map((at) => attribute(key).getInt32(at, true)));
  if (String(data) !== String(display)) {
    throw new ExrError(name, `has a data window of ${data} in a display window of ${display}; this page reads whole images`);
  }
  const [left, first, right, last] = data, width = right - left + 1, height = last - first + 1;
  if (!isImageSize(width, height)) throw new ExrError(name, `is ${width} x ${height}; want ${IMAGE_SIZE}`);
  const compression = attribute("compression").getUint8(0), rows = BLOCK_ROWS[compression];
  if (rows === undefined) {
    const written = COMPRESSIONS[compression] ?? `of kind ${compression}`;
    throw new ExrError(name, `has compression ${written}; this page reads ZIP, ZIPS and none. Copy the shot with supersampler import`);
  }
  const channels = readChannels(attribute("channels"), name);
  const rowBytes = channels.reduce((sum, { type }) => sum + width * 2 * type, 0);
  if (rowBytes * height > PLANE_BYTES) {
    throw new ExrError(name, `has ${(rowBytes * height) / 2 ** 20} MiB of pixels; this page reads at most ${PLANE_BYTES / 2 ** 20}`);
  }
  const blocks = readBlocks(view, end, { rows, height, first, rowBytes, isPacked: compression !== NO_COMPRESSION }, name);
  return { width, height, channels, blocks };
}

/** @param {DataView} view @param {string} name @returns {{ attributes: Map<string, DataView>, end: number }} */
function readAttributes(view, name) {
  const attributes = new Map();
  for (let at = 8; ;) {
    const [attribute, afterName] = textAt(view, at);
    if (!attribute) return { attributes, end: afterName };
    const [, afterType] = textAt(view, afterName), size = view.getInt32(afterType, true);
    if (attributes.has(attribute)) throw damaged(name, `it has ${attribute} twice`);
    if (attributes.size === ATTRIBUTES) throw damaged(name, `it has more than ${ATTRIBUTES} attributes`);
    at = afterType + 4;
    attributes.set(attribute, new DataView(view.buffer, at, size));
    at += size;
  }
}

/** @param {DataView} view @param {number} at @returns {[string, number]} text up to a zero, and what follows */
function textAt(view, at) {
  let found = "";
  for (let code = view.getUint8(at++); code; code = view.getUint8(at++)) {
    if (found.length === NAME_BYTES) throw new RangeError(`a name of more than ${NAME_BYTES} bytes`);
    found += String.fromCharCode(code);
  }
  return [found, at];
}

/** @param {DataView} view @param {string} name @returns {{ channel: string, type: number }[]} in the file's order */
function readChannels(view, name) {
  const channels = new Map();
  for (let [channel, at] = textAt(view, 0); channel; [channel, at] = textAt(view, at)) {
    const type = view.getInt32(at, true);
    if ((type !== HALF && type !== FLOAT) || view.getInt32(at + 8, true) !== 1 || view.getInt32(at + 12, true) !== 1) {
      throw new ExrError(name, `channel ${channel} is of whole numbers or subsampled; want half or float`);
    }
    if (channels.has(channel)) throw damaged(name, `it has channel ${channel} twice`);
    if (channels.size === CHANNELS) throw new ExrError(name, `has more than ${CHANNELS} channels`);
    channels.set(channel, { channel, type });
    at += 16;
  }
  if (!channels.size) throw damaged(name, "it has no channels");
  return [...channels.values()];
}

/**
 * @param {DataView} view @param {number} table where the places of the blocks begin
 * @param {{ rows: number, height: number, first: number, rowBytes: number, isPacked: boolean }} image `rows` of a
 *   block, `first` y of the image @param {string} name
 * @returns {Block[]} all of them in the file, none with bytes of another, and with a plausible number of bytes
 */
function readBlocks(view, table, { rows, height, first, rowBytes, isPacked }, name) {
  const blocks = Array.from({ length: Math.ceil(height / rows) }, (_, index) => {
    const at = Number(view.getBigUint64(table + 8 * index, true)) + 8, top = index * rows;
    const count = Math.min(rows, height - top), bytes = rowBytes * count;
    const y = view.getInt32(at - 8, true), size = view.getInt32(at - 4, true);
    if (y !== first + top) throw damaged(name, `the block of row ${first + top} states row ${y}`);
    if (size > bytes || size < (isPacked ? bytes / EXPANSION : bytes)) {
      throw damaged(name, `rows from ${top} on are ${size} bytes, which cannot be ${bytes}`);
    }
    if (at + size > view.byteLength) throw damaged(name, `rows from ${top} on reach beyond its end`);
    return { at, size, bytes, top, count };
  });
  let free = table + 8 * blocks.length;
  for (const { at, size, top } of [...blocks].sort((one, other) => one.at - other.at)) {
    if (at - 8 < free) throw damaged(name, `rows from ${top} on have bytes of something else`);
    free = at + size;
  }
  return blocks;
}

/** @param {Uint8Array} packed by zlib @param {number} bytes that it must become @param {string} name @returns {Promise<Uint8Array>} */
async function inflate(packed, bytes, name) {
  let from = 0, at = 0;
  const source = new ReadableStream({
    pull(controller) {
      if (from >= packed.length) controller.close();
      else controller.enqueue(packed.subarray(from, from += INPUT_BYTES));
    },
  });
  const reader = source.pipeThrough(new DecompressionStream("deflate")).getReader(), inflated = new Uint8Array(bytes);
  const next = () => reader.read().catch((error) => {
    throw damaged(name, error.message);
  });
  for (let part = await next(); !part.done; part = await next()) {
    if (part.value.length > bytes - at) {
      reader.cancel().catch(() => {}); // the file is refused whatever the stream answers
      throw damaged(name, `a block becomes more than ${bytes} bytes`);
    }
    inflated.set(part.value, at);
    at += part.value.length;
  }
  if (at !== bytes) throw damaged(name, `a block becomes ${at} bytes; want ${bytes}`);
  return inflated;
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
