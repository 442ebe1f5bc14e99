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

import { readExr } from "./exr.js";

const COLOR = ["R", "G", "B"], DEPTH = ["depth.Z"], MOTION = ["motion.X", "motion.Y"];
const DEFAULT_SCALE = 2;

/** A shot that cannot be shown; the message names the file and what is missing. */
export class ShotError extends Error {
  /** @param {string} message */
  constructor(message) {
    super(message);
    this.name = "ShotError";
  }
}

export class ShotFolder {
  /**
   * @param {(name: string) => Promise<ArrayBuffer>} read a file of the folder, by its name in shot.json
   * @returns {Promise<ShotFolder>}
   * @throws {ShotError} shot.json is missing or wrong, or in other conventions
   */
  static async open(read) {
    const text = new TextDecoder().decode(await read("shot.json"));
    let info;
    try {
      info = JSON.parse(text);
    } catch (error) {
      throw new ShotError(`shot.json is no JSON: ${error.message}.`);
    }
    if (info?.version !== 1 || !Array.isArray(info.frames) || !info.frames.length || !isSize(info.render_size)) {
      throw new ShotError("shot.json is of another version, or lacks render_size or frames. docs/shots.md has the format.");
    }
    const foreign = Object.keys(info.conventions ?? {});
    if (foreign.length) {
      throw new ShotError(`shot.json states conventions of its own (${foreign.join(", ")}). Convert it: supersampler import SHOT -o CONVERTED`);
    }
    return new ShotFolder(info, read);
  }

  /** @param {any} info of shot.json @param {(name: string) => Promise<ArrayBuffer>} read */
  constructor(info, read) {
    this.info = info;
    this.read = read;
    /** @type {string} */ this.name = info.name ?? "shot";
    /** @type {number} */ this.length = info.frames.length;
    /** @type {[number, number]} */
    this.displaySize = isSize(info.display_size) ? info.display_size : info.render_size.map((side) => DEFAULT_SCALE * side);
  }

  /**
   * @param {number} index @returns {Promise<ShotFrame>}
   * @throws {ShotError} channels are missing, or the image has another size
   */
  async frame(index) {
    const entry = this.info.frames[index], size = entry.render_size ?? this.info.render_size;
    const [color, depth, motion] = await this.#planes(entry.file, size, [COLOR, DEPTH, MOTION]);
    return {
      size, color, depth: depth[0], motion,
      jitter: entry.jitter, reset: index === 0 || entry.reset === true, exposure: entry.exposure ?? null,
      reference: async () => {
        if (!entry.reference) return null;
        const [planes] = await this.#planes(entry.reference, this.displaySize, [COLOR]);
        return { size: this.displaySize, planes };
      },
    };
  }

  /** @param {string} file @param {[number, number]} size @param {string[][]} groups of channels @returns {Promise<Plane[][]>} */
  async #planes(file, size, groups) {
    const { width, height, planes } = await readExr(await this.read(file), file);
    if (width !== size[0] || height !== size[1]) {
      throw new ShotError(`${file} is ${width} x ${height}; shot.json says ${size.join(" x ")}.`);
    }
    const missing = groups.flat().filter((channel) => !planes.has(channel));
    if (missing.length) throw new ShotError(`${file} has no channel ${missing.join(", ")}; it has ${[...planes.keys()].join(", ")}.`);
    return groups.map((channels) => channels.map((channel) => planes.get(channel)));
  }
}

const isSize = (value) => Array.isArray(value) && value.length === 2 && value.every((side) => Number.isInteger(side) && side > 0);

/** @param {URL} folder @returns {(name: string) => Promise<ArrayBuffer>} reads files of a server's folder */
export function readerOfUrl(folder) {
  return async (name) => {
    const answer = await fetch(new URL(name, folder));
    if (!answer.ok) throw new ShotError(`${name} cannot be read from the server: ${answer.status} ${answer.statusText}.`);
    return answer.arrayBuffer();
  };
}

/**
 * @param {Map<string, File>} files by their paths below the dropped folder
 * @returns {(name: string) => Promise<ArrayBuffer>}
 */
export function readerOfFiles(files) {
  return async (name) => {
    const file = files.get(name);
    if (!file) throw new ShotError(`${name} is missing among the ${files.size} files of the folder.`);
    return file.arrayBuffer();
  };
}

/**
 * The files of a dropped folder. Call it in the handler of the drop itself: its items are void afterwards.
 * @param {DataTransfer} dropped @returns {Promise<Map<string, File>>} by their paths below the folder
 * @throws {ShotError} what was dropped is no folder
 */
export function droppedFiles(dropped) {
  const entry = dropped.items[0]?.webkitGetAsEntry();
  if (!entry?.isDirectory) return Promise.reject(new ShotError("Drop a folder that has a shot.json."));
  return filesBelow(/** @type {FileSystemDirectoryEntry} */ (entry), "");
}

/** @param {FileSystemDirectoryEntry} folder @param {string} prefix @returns {Promise<Map<string, File>>} */
async function filesBelow(folder, prefix) {
  const files = new Map(), reader = folder.createReader();
  const read = () => new Promise((resolve, reject) => reader.readEntries(resolve, reject));
  for (let entries = await read(); entries.length; entries = await read()) { // a reader gives a hundred at a time
    for (const entry of entries) {
      const path = prefix + entry.name;
      if (entry.isDirectory) for (const [below, file] of await filesBelow(entry, `${path}/`)) files.set(below, file);
      else files.set(path, await new Promise((resolve, reject) => entry.file(resolve, reject)));
    }
  }
  return files;
}

/** @param {FileList} list of an input that chooses folders @returns {Map<string, File>} by their paths below the folder */
export function chosenFiles(list) {
  return new Map(Array.from(list, (file) => [file.webkitRelativePath.split("/").slice(1).join("/"), file]));
}
