/** The page on WebGPU: controls, the loop of frames, and a dropped shot. */

import { SceneRenderer } from "../scene/renderer.js";
import { Comparison } from "./comparison.js";
import { requestGpu } from "./gpu.js";
import { LiveSource } from "./live_source.js";
import { ShotFolder, chosenFiles, droppedFiles, readerOfFiles, readerOfUrl } from "./shot_folder.js";
import { ShotSource } from "./shot_source.js";
import { Testing } from "./testing.js";

const SHIPPED_SHOT = new URL("../shot/", import.meta.url);
const SOFTWARE_DEFAULTS = { size: "320x180", method: "taau" };
const LONGEST_STEP = 1 / 15; // seconds; longer motion does not look live
const nextAnimationFrame = () => new Promise(requestAnimationFrame);

/**
 * Starts the page. Throws where WebGPU is missing or the shaders do not compile: nothing is shown yet then.
 * @param {{ form: HTMLFormElement, stage: import("./stage.js").Stage, say: (text: string) => void, query: URLSearchParams }} options
 */
export async function startGpuPage({ form, stage, say, query }) {
  const gpu = await requestGpu(), isTest = query.has("test");
  if (gpu.isSoftware) {
    for (const [name, value] of Object.entries(SOFTWARE_DEFAULTS)) {
      if (!query.has(name)) form.elements[name].value = value;
    }
  }
  const page = new GpuPage(gpu, form, stage, say);
  gpu.device.pushErrorScope("validation");
  try {
    page.renderer = await SceneRenderer.make(gpu.device);
    page.comparison = await Comparison.make(gpu, stage);
    await page.apply();
    performance.mark("compiled");
    await page.comparison.step(0);
    await gpu.device.queue.onSubmittedWorkDone();
    const refused = await gpu.device.popErrorScope();
    if (refused) throw new Error(refused.message);
  } catch (error) {
    throw new Error(page.named(error), { cause: error });
  }
  performance.mark("first-image");
  page.setPaused(isTest);
  page.listen();
  page.run();
  if (isTest) window.supersamplerDemo = new Testing(page.comparison, () => page.settled());
}

class GpuPage {
  /**
   * @param {import("./gpu.js").Gpu} gpu @param {HTMLFormElement} form @param {import("./stage.js").Stage} stage
   * @param {(text: string) => void} say
   */
  constructor(gpu, form, stage, say) {
    this.gpu = gpu;
    this.form = form;
    /** @type {Record<string, any>} by name */ this.controls = form.elements;
    this.stage = stage;
    this.say = say;
    /** @type {SceneRenderer} */ this.renderer = undefined;
    /** @type {Comparison} */ this.comparison = undefined;
    /** @type {ShotFolder | null} a shot of the user's */ this.ownShot = null;
    this.isPaused = false;
    this.isStepping = false; // one frame, though paused
    this.isChanged = false; // a control
    this.isStale = false; // the stage
    this.isWorking = false; // in a turn of the loop
  }

  /** @param {{ name?: string, message: string }} error @returns {string} its message, with the adapter's name */
  named(error) {
    return error.name === "UpscalerError" ? error.message : `${this.gpu.adapter}: ${error.message}`;
  }

  /** @param {boolean} isPaused */
  setPaused(isPaused) {
    this.isPaused = isPaused;
    this.controls.pause.setAttribute("aria-pressed", String(isPaused));
  }

  /** Brings source, method and sizes to what the controls say. */
  async apply() {
    const { source, method, ratio, size, camera } = this.controls;
    const made = await this.#source(source.value, size.value.split("x").map(Number), Number(ratio.value));
    if (made !== this.comparison.source || method.value !== this.comparison.method) await this.comparison.set(made, method.value);
    if (made instanceof LiveSource) made.cameraMoves = camera.checked;
    for (const control of [ratio, size, camera]) control.closest("label").hidden = !(made instanceof LiveSource);
  }

  /** @param {string} kind of the frames @param {[number, number]} size of the live scene @param {number} ratio */
  async #source(kind, size, ratio) {
    const before = this.comparison.source, shot = kind === "own" ? this.ownShot : null;
    if (kind === "live") {
      if (before instanceof LiveSource && String(before.displaySize) === String(size)) {
        if (before.ratio !== ratio) before.setRatio(ratio);
        return before;
      }
      return new LiveSource(this.renderer, size, ratio);
    }
    if (before instanceof ShotSource && before.kind === kind && before.shot === (shot ?? before.shot)) return before;
    return new ShotSource(this.gpu.device, shot ?? (await ShotFolder.open(readerOfUrl(SHIPPED_SHOT))), kind);
  }

  /** Listens to controls, the stage, and dropped folders. */
  listen() {
    const { pause, single } = this.controls, drop = document.getElementById("drop");
    this.form.addEventListener("change", () => {
      this.isChanged = true;
    });
    pause.addEventListener("click", () => this.setPaused(!this.isPaused));
    single.addEventListener("click", () => {
      this.setPaused(true);
      this.isStepping = true;
    });
    this.stage.onChange = () => {
      this.isStale = true;
    };
    document.addEventListener("dragover", (event) => {
      event.preventDefault();
      drop.classList.add("over");
    });
    document.addEventListener("dragleave", () => drop.classList.remove("over"));
    document.addEventListener("drop", (event) => {
      event.preventDefault();
      drop.classList.remove("over");
      this.#take(droppedFiles(event.dataTransfer));
    });
    const chosen = /** @type {HTMLInputElement} */ (drop.querySelector("input"));
    chosen.addEventListener("change", () => this.#take(Promise.resolve(chosenFiles(chosen.files))));
    this.gpu.device.addEventListener("uncapturederror", ({ error }) => this.say(this.named(error)));
    this.gpu.device.lost.then(({ message }) => this.say(`${this.gpu.adapter} was lost: ${message} Load the page again.`));
  }

  /** @param {Promise<Map<string, File>>} files of a shot folder */
  async #take(files) {
    try {
      const shot = await ShotFolder.open(readerOfFiles(await files));
      await shot.frame(0); // says now what is missing
      this.ownShot = shot;
    } catch (error) {
      this.say(error.message);
      return;
    }
    this.say("");
    const option = this.controls.source.querySelector("[value=own]");
    option.textContent = `shot ${this.ownShot.name}`;
    option.hidden = false;
    this.controls.source.value = "own";
    this.isChanged = true;
  }

  /** Draws frames for as long as the page is open. */
  async run() {
    for (let last = await nextAnimationFrame(); ;) {
      this.isWorking = false;
      const now = await nextAnimationFrame();
      this.isWorking = true;
      try {
        if (this.isChanged) {
          this.isChanged = false;
          await this.apply();
          this.isStepping = true;
          this.say("");
        }
        const seconds = (now - last) / 1000;
        if (this.isStepping || (!this.isPaused && seconds >= 0.9 * this.comparison.source.interval)) {
          await this.comparison.step(Math.min(seconds, LONGEST_STEP));
          this.#showTimes(seconds);
          [last, this.isStepping, this.isStale] = [now, false, false];
        } else if (this.isStale) {
          this.isStale = false;
          await this.comparison.present();
        }
      } catch (error) {
        this.say(this.named(error));
        this.setPaused(true);
        this.isStepping = false;
      }
    }
  }

  /** Resolves when all changes of the controls and the stage are on the screen. */
  async settled() {
    do await nextAnimationFrame(); while (this.isChanged || this.isStepping || this.isStale || this.isWorking);
    await this.gpu.device.queue.onSubmittedWorkDone();
  }

  #showTimes(seconds) {
    const { times, source, frame } = this.comparison;
    const sizes = `${frame.size.join("x")} to ${source.displaySize.join("x")}`;
    const stages = times
      ? `${source instanceof LiveSource ? `rendering ${times.raster.toFixed(2)} ms, ` : ""}upscaling ${times.upscaling.toFixed(2)} ms`
      : "no GPU times: the adapter has no timestamp queries";
    const missing = frame.truth === null ? "; this frame has no reference" : "";
    document.getElementById("times").textContent = `${sizes}; ${stages}; ${(1000 * seconds).toFixed(0)} ms from frame to frame; ${this.gpu.adapter}${missing}`;
  }
}
