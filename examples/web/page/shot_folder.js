/**
 * Shot folders (docs/shots.md): a shot.json and EXR frames, from a server or dropped onto the page.
 * @typedef {import("./exr.js").Plane} Plane
 *
 * @typedef {object} ShotFrame
 * @property {[number, number]} size width and height, pixels
 * @property {Plane[]} color red, green, blue
 * @property {Plane} depth
 * @property {Plane[]} motion x and y
 * @property {[number, number]} jitter
 * @property {boolean} reset
 * @property {number | null} exposure null: to be measured
 * @property {() => Promise<{ size: [number, number], planes: Plane[] } | null>} reference
 */

import { Field, bodyOf, fitsRatio, parsedJson } from "../supersampler_folder.js";
import { IMAGE_SIZE, isImageSize, readExr } from "./exr.js";

const COLOR = ["R", "G", "B"], DEPTH = ["depth.Z"], MOTION = ["motion.X", "motion.Y"];
const DEFAULT_SCALE = 2;
const RATIOS = [1 / 8, 8]; // of display to render size, beyond those of all methods

const JSON_BYTES = 1 << 24, FILE_BYTES = 2 ** 30, FRAMES = 1 << 20, TEXT = 4096;
const NAME_BYTES = 255, FORBIDDEN = /[\\:\x00-\x1f\ud800-\udfff]/u; // of names of files, as in supersampler.io.shot.format
const UTF8 = new TextEncoder();
const MAX_DROPPED = 1 << 17, MAX_DEPTH = 16; // files, and folders in folders, of a dropped folder

/** A shot that cannot be shown; the message names the file and what is missing. */
export class ShotError extends Error {
  /** @param {string} message */
  constructor(message) {
    super(message);
    this.name = "ShotError";
  }
}

/**
 * @typedef {object} Entry a frame of shot.json, checked
 * @property {string} file @property {string | null} reference file
 * @property {[number, number]} size @property {[number, number]} jitter
 * @property {boolean} reset @property {number | null} exposure
 * @typedef {(name: string, max: number) => Promise<ArrayBuffer>} Read reads a file of the folder, by its name in
 *   shot.json; throws a ShotError where it has more than `max` bytes
 */

export class ShotFolder {
  /**
   * @param {Read} read
   * @returns {Promise<ShotFolder>}
   * @throws {ShotError} shot.json is missing or wrong, or in other conventions
   */
  static async open(read) {
    const text = new TextDecoder().decode(await read("shot.json", JSON_BYTES));
    const info = parsedJson(text, (place, got, want) => new ShotError(
      `shot.json: ${place || "the file"} is ${got}; want ${want}. docs/shots.md has the format.`,
    ));
    info.at("version").oneOf([1]);
    const foreign = info.read("conventions", (conventions) => Object.keys(conventions.object()), []);
    if (foreign.length) {
      throw new ShotError(`shot.json states conventions of its own (${foreign.join(", ").slice(0, TEXT)}). Convert it: supersampler import SHOT -o CONVERTED`);
    }
    return new ShotFolder(info, read);
  }

  /** @param {Field} info the content of shot.json @param {Read} read */
  constructor(info, read) {
    this.read = read;
    const renderSize = sizeOf(info.at("render_size"));
    /** @type {string} */ this.name = info.read("name", (name) => name.text(TEXT), "shot");
    /** @type {[number, number]} */
    this.displaySize = info.read("display_size", sizeOf, null) ?? renderSize.map((side) => DEFAULT_SCALE * side);
    if (!isImageSize(...this.displaySize)) info.at("display_size").refuse(IMAGE_SIZE);
    /** @type {number | null} frames a second */ this.frameRate = info.read("frame_rate", (rate) => rate.positive(), null);
    /** @type {Entry[]} */
    this.entries = info.at("frames").items(1, FRAMES).map((entry) => {
      const size = entry.read("render_size", sizeOf, renderSize);
      if (!fitsRatio(RATIOS, size, this.displaySize)) entry.refuse(`a frame of a size that display_size, ${this.displaySize.join(" x ")}, is at most 8 times`);
      return {
        file: fileOf(entry.at("file")), reference: entry.read("reference", fileOf, null), size,
        jitter: entry.at("jitter").pair((one) => one.number(-0.5, 0.5)),
        reset: entry.read("reset", (reset) => reset.oneOf([true, false]), false),
        exposure: entry.read("exposure", (exposure) => exposure.positive(), null),
      };
    });
    this.length = this.entries.length;
  }

  /**
   * @param {number} index @returns {Promise<ShotFrame>}
   * @throws {ShotError} channels are missing, or the image has another size
   */
  async frame(index) {
    const entry = this.entries[index], { size, jitter, exposure } = entry;
    const [color, depth, motion] = await this.#planes(entry.file, size, [COLOR, DEPTH, MOTION]);
    return {
      size, color, depth: depth[0], motion, jitter, reset: index === 0 || entry.reset, exposure,
      reference: async () => {
        if (!entry.reference) return null;
        const [planes] = await this.#planes(entry.reference, this.displaySize, [COLOR]);
        return { size: this.displaySize, planes };
      },
    };
  }

  /** @param {string} file @param {[number, number]} size @param {string[][]} groups of channels @returns {Promise<Plane[][]>} */
  async #planes(file, size, groups) {
    const { planes } = await readExr(await this.read(file, FILE_BYTES), file, ({ width, height, channels }) => {
      if (width !== size[0] || height !== size[1]) {
        throw new ShotError(`${file} is ${width} x ${height}; shot.json says ${size.join(" x ")}.`);
      }
      const missing = groups.flat().filter((channel) => !channels.includes(channel));
      if (missing.length) throw new ShotError(`${file} has no channel ${missing.join(", ")}; it has ${channels.join(", ").slice(0, TEXT)}.`);
    });
    return groups.map((channels) => channels.map((channel) => planes.get(channel)));
  }
}

/** @param {Field} field @returns {[number, number]} */
function sizeOf(field) {
  const size = field.pair((side) => side.whole(1, Infinity));
  return isImageSize(...size) ? size : field.refuse(IMAGE_SIZE);
}

/** @param {Field} field @returns {string} name of a file which is below the folder, for a file system and in a URL */
function fileOf(field) {
  const parts = field.text(TEXT).split("/");
  const isBelow = parts.every((part) => !["", ".", ".."].includes(part) && !FORBIDDEN.test(part) && UTF8.encode(part).length <= NAME_BYTES);
  return isBelow ? field.value : field.refuse(`a file inside the shot's folder, with forward slashes and names of at most ${NAME_BYTES} bytes`);
}

/**
 * @template Value @param {string} name of a file @param {Promise<Value>} reading @returns {Promise<Value>}
 * @throws {ShotError} the browser's error, with the name
 */
const named = (name, reading) => reading.catch((error) => {
  throw new ShotError(`${name} cannot be read: ${error.message}.`);
});

const tooLarge = (name, max) => new ShotError(`${name} is larger than ${max >> 20} MiB.`);

/** @param {URL} folder @returns {Read} reads files of a server's folder */
export function readerOfUrl(folder) {
  return async (name, max) => {
    const encoded = name.split("/").map(encodeURIComponent).join("/"); // "%2e%2e" would leave the folder
    const answer = await named(name, fetch(new URL(encoded, folder)));
    if (!answer.ok) throw new ShotError(`${name} cannot be read from the server: ${answer.status} ${answer.statusText}.`);
    const body = await named(name, bodyOf(answer, max));
    if (!body) throw tooLarge(name, max);
    return body;
  };
}

/**
 * @param {Map<string, File>} files by their paths below the dropped folder
 * @returns {Read}
 */
export function readerOfFiles(files) {
  return async (name, max) => {
    const file = files.get(name);
    if (!file) throw new ShotError(`${name} is missing among the ${files.size} files of the folder.`);
    if (file.size > max) throw tooLarge(name, max);
    return named(name, file.arrayBuffer());
  };
}

/**
 * The files of a dropped folder. Call it in the handler of the drop itself: its items are void afterwards.
 * @param {DataTransfer} dropped @returns {Promise<Map<string, File>>} by their paths below the folder
 * @throws {ShotError} it is not a folder, or has too many files or nested folders
 */
export function droppedFiles(dropped) {
  const entry = dropped.items[0]?.webkitGetAsEntry();
  if (!entry?.isDirectory) return Promise.reject(new ShotError("Drop a folder that has a shot.json."));
  return filesBelow(/** @type {FileSystemDirectoryEntry} */ (entry));
}

/** @param {FileSystemDirectoryEntry} root @returns {Promise<Map<string, File>>} */
async function filesBelow(root) {
  const files = new Map(), folders = [{ folder: root, prefix: "", depth: 0 }];
  let count = 0;
  for (const { folder, prefix, depth } of folders) { // it grows
    const reader = folder.createReader();
    const read = () => named(folder.name, new Promise((resolve, reject) => reader.readEntries(resolve, reject)));
    for (let entries = await read(); entries.length; entries = await read()) { // a reader gives a hundred at a time
      for (const entry of entries) {
        const path = prefix + entry.name;
        if (++count > MAX_DROPPED) throw new ShotError(`${root.name} has more than ${MAX_DROPPED} files.`);
        if (!entry.isDirectory) files.set(path, await named(path, new Promise((resolve, reject) => entry.file(resolve, reject))));
        else if (depth < MAX_DEPTH) folders.push({ folder: entry, prefix: `${path}/`, depth: depth + 1 });
        else throw new ShotError(`${path} is a folder in more than ${MAX_DEPTH} others.`);
      }
    }
  }
  return files;
}

/** @param {FileList} list of an input that chooses folders @returns {Map<string, File>} by their paths below the folder */
export function chosenFiles(list) {
  return new Map(Array.from(list, (file) => [file.webkitRelativePath.split("/").slice(1).join("/"), file]));
}
