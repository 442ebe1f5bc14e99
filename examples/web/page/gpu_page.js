/** The page on WebGPU: controls, the loop of frames, and a dropped shot. */

import { SceneRenderer } from "../scene/renderer.js";
import { Comparison } from "./comparison.js";
import { requestGpu } from "./gpu.js";
import { LiveSource } from "./live_source.js";
import { ShotFolder, chosenFiles, droppedFiles, readerOfFiles, readerOfUrl } from "./shot_folder.js";
import { ShotSource } from "./shot_source.js";
import { Testing } from "./testing.js";

const SHIPPED_SHOT = new URL("../shot/", import.meta.url);
const DEFAULTS = { hardware: { method: "classifier-large" }, software: { size: "320x180", method: "taau" } };
const LONGEST_STEP = 1 / 15; // seconds; longer motion does not look live
const LOSS_DELAY = 1000; // milliseconds
const nextAnimationFrame = () => new Promise(requestAnimationFrame);

/**
 * Runs the page until the GPU is lost. Throws then, and where WebGPU is missing or the shaders do not compile; the message
 * is for the person at the page.
 * @param {{ form: HTMLFormElement, stage: import("./stage.js").Stage, say: (text: string) => void, query: URLSearchParams }} options
 */
export async function runGpuPage({ form, stage, say, query }) {
  const gpu = await requestGpu(), isTest = query.has("test"), page = new GpuPage(gpu, form, stage, say);
  for (const [name, value] of Object.entries(DEFAULTS[gpu.isSoftware ? "software" : "hardware"])) {
    if (!query.has(name)) form.elements[name].value = value;
  }
  try {
    await page.guarded(async () => {
      page.renderer = await SceneRenderer.make(gpu.device);
      page.comparison = await Comparison.make(gpu, stage);
      await page.apply();
      performance.mark("compiled");
      await page.comparison.step(0);
    });
  } catch (error) {
    throw new Error(page.named(error), { cause: error });
  }
  performance.mark("first-image");
  page.setPaused(isTest);
  page.listen();
  if (isTest) window.supersamplerDemo = new Testing(page.comparison, () => page.settled());
  await page.run();
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
    /** @type {ShotFolder | null} the user's shot */ this.ownShot = null;
    this.isPaused = false;
    this.isStepping = false; // one frame, though paused
    this.isChanged = false; // a control
    this.isStale = false; // the stage
    this.isWorking = false; // inside an iteration of the loop
    this.isBroken = false; // until a control changes
    this.listening = new AbortController();
    /** @type {string | null} why the GPU is lost */ this.lost = null;
    gpu.device.lost.then(({ message, reason }) => {
      this.lost = message || reason;
    });
  }

  /** Runs an action that allocates or compiles; throws the device's errors. @param {() => Promise<void>} action */
  async guarded(action) {
    const { device } = this.gpu, filters = ["validation", "out-of-memory"];
    for (const filter of filters) device.pushErrorScope(filter);
    let thrown;
    try {
      await action();
      await device.queue.onSubmittedWorkDone();
    } catch (error) {
      thrown = error;
    }
    const [memory, invalid] = [await device.popErrorScope(), await device.popErrorScope()];
    if (memory) throw new Error(`not enough memory for this size (${memory.message}). Choose a smaller one.`);
    if (thrown ?? invalid) throw thrown ?? new Error(invalid.message);
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

  /** Applies the controls: source, method and sizes. */
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
    const { pause, single } = this.controls, drop = document.getElementById("drop"), { signal } = this.listening;
    this.form.addEventListener("change", () => {
      this.isChanged = true;
    }, { signal });
    pause.addEventListener("click", () => this.setPaused(!this.isPaused), { signal });
    single.addEventListener("click", () => {
      this.setPaused(true);
      this.isStepping = true;
    }, { signal });
    this.stage.onChange = () => {
      this.isStale = true;
    };
    document.addEventListener("dragover", (event) => {
      event.preventDefault();
      drop.classList.add("over");
    }, { signal });
    document.addEventListener("dragleave", () => drop.classList.remove("over"), { signal });
    document.addEventListener("drop", (event) => {
      event.preventDefault();
      drop.classList.remove("over");
      this.#take(droppedFiles(event.dataTransfer));
    }, { signal });
    const chosen = /** @type {HTMLInputElement} */ (drop.querySelector("input"));
    chosen.addEventListener("change", () => this.#take(Promise.resolve(chosenFiles(chosen.files))), { signal });
    this.gpu.device.addEventListener("uncapturederror", ({ error }) => this.say(this.named(error)), { signal });
  }

  /** @param {Promise<Map<string, File>>} files of a shot folder */
  async #take(files) {
    try {
      const shot = await ShotFolder.open(readerOfFiles(await files));
      await shot.frame(0); // names missing channels now
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

  /** Draws frames until the device is lost, and throws then. */
  async run() {
    for (let last = await nextAnimationFrame(); this.lost === null;) {
      this.isWorking = false;
      const now = await nextAnimationFrame();
      this.isWorking = true;
      try {
        const seconds = (now - last) / 1000, isDue = !this.isPaused && seconds >= 0.9 * this.comparison.source.interval;
        const step = () => this.comparison.step(Math.min(seconds, LONGEST_STEP));
        if (this.isChanged) {
          this.isChanged = this.isBroken = false;
          await this.guarded(async () => {
            await this.apply();
            await step();
          });
          this.say("");
        } else if (this.isBroken) {
          this.isStepping = this.isStale = false;
        } else if (this.isStepping || isDue) {
          await step();
          this.#showTimes(seconds);
          [last, this.isStepping, this.isStale] = [now, false, false];
        } else if (this.isStale) {
          this.isStale = false;
          await this.comparison.present();
        }
      } catch (error) {
        this.say(this.named(error));
        this.isBroken = true;
        await this.#findLoss(error);
      }
    }
    this.listening.abort();
    throw new Error(`${this.gpu.adapter} was lost: ${this.lost.replace(/\.$/, "")}. Load the page again to use it.`);
  }

  /** Waits for the loss of the device that may have caused an error. @param {Error} error */
  async #findLoss(error) {
    if (!(error instanceof DOMException)) return;
    await Promise.race([this.gpu.device.lost, new Promise((resolve) => setTimeout(resolve, LOSS_DELAY))]);
    this.lost ??= error.message; // the browser's part of WebGPU is gone
  }

  /** Resolves when all changes of the controls and the stage are on the screen. */
  async settled() {
    do await nextAnimationFrame(); while (this.isChanged || this.isStepping || this.isStale || this.isWorking);
    await this.gpu.device.queue.onSubmittedWorkDone();
  }

  #showTimes(seconds) {
    const { times, source, frame } = this.comparison, interval = `a frame every ${(1000 * seconds).toFixed(1)} ms`;
    const share = (frame.size[0] * frame.size[1]) / (source.displaySize[0] * source.displaySize[1]);
    document.getElementById("facts").textContent =
      `Rendered at ${frame.size.join("x")}, shown at ${source.displaySize.join("x")}: ${(100 * share).toFixed(0)} % of the pixels are rendered.`;
    const stages = times ? `${gpuTimes(times, source instanceof LiveSource)}; ${interval}` : `${interval}; this adapter measures no GPU times`;
    const missing = frame.truth === null ? "; this frame has no reference" : "";
    document.getElementById("times").textContent = `${stages}; ${this.gpu.adapter}${missing}`;
  }
}

/** @param {import("./timing.js").StageTimes} times @param {boolean} isLive whether the frame was rendered here @returns {string} */
function gpuTimes({ raster, upscaling, views }, isLive) {
  const stages = [...(isLive ? [["rendering", raster]] : []), ["upscaling", upscaling], ["showing the views", views]];
  const rounded = stages.map(([name, time]) => [name, Number(time.toFixed(2))]);
  const sum = rounded.reduce((total, [, time]) => total + time, 0);
  return `GPU ${sum.toFixed(2)} ms: ${rounded.map(([name, time]) => `${name} ${time.toFixed(2)}`).join(", ")}`;
}
