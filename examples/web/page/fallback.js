/** The page without WebGPU: the shipped shot through the CPU library. */

import { CanvasPresenter } from "./canvas_presenter.js";
import { CpuStep } from "./cpu_step.js";
import { ShotFolder, readerOfUrl } from "./shot_folder.js";
import { ExposureMeter, asFloat } from "./shot_source.js";

const SHIPPED_SHOT = new URL("../shot/", import.meta.url);

/**
 * @param {string} reason why WebGPU is not used
 * @param {{ form: HTMLFormElement, stage: import("./stage.js").Stage, say: (text: string) => void }} options
 */
export async function startFallback(reason, { form, stage, say }) {
  /** @type {Record<string, any>} */ const controls = form.elements;
  say(`${reason} The live scene needs WebGPU. Loading the shipped shot instead ...`);
  controls.source.value = "shot";
  for (const name of ["source", "ratio", "size", "camera"]) controls[name].closest("label").hidden = true;
  document.getElementById("drop").hidden = true;
  try {
    const shot = await ShotFolder.open(readerOfUrl(SHIPPED_SHOT)), page = new FallbackPage(controls, stage, shot);
    const how = await page.load().then(() => "Here the CPU library upscales the shipped shot, in WebAssembly.", (error) => {
      console.info(error);
      return `The shipped shot is shown without being upscaled, as the CPU library cannot be loaded: ${error.message}`;
    });
    say(`${reason} The live scene needs WebGPU. ${how}`);
    await page.run();
  } catch (error) {
    say(`${reason} The live scene needs WebGPU. The shipped shot cannot be shown: ${error.message}`);
  }
}

class FallbackPage {
  /**
   * @param {Record<string, any>} controls by name @param {import("./stage.js").Stage} stage
   * @param {ShotFolder} shot
   */
  constructor(controls, stage, shot) {
    this.controls = controls;
    this.stage = stage;
    this.shot = shot;
    /** @type {CpuStep | null} null: nothing is upscaled */ this.step = null;
    // A canvas that WebGPU has used gives no 2D context: take a fresh one.
    const canvas = /** @type {HTMLCanvasElement} */ (stage.canvas.cloneNode());
    stage.canvas.replaceWith(canvas);
    stage.canvas = canvas;
    stage.setSize(shot.displaySize);
    stage.nameTruth("reference");
    this.presenter = new CanvasPresenter(canvas);
    this.meter = new ExposureMeter();
    stage.onChange = () => this.presenter.present(stage.shown);
  }

  /** Loads the method that is chosen. */
  async load() {
    this.method = this.controls.method.value;
    this.step = await CpuStep.load(this.method, this.shot.displaySize);
  }

  /** Shows frame after frame, and never returns. */
  async run() {
    const { pause, single, method } = this.controls;
    let isPaused = false, wake = () => {};
    method.addEventListener("change", () => wake());
    pause.addEventListener("click", () => {
      isPaused = !isPaused;
      pause.setAttribute("aria-pressed", String(isPaused));
      wake();
    });
    single.addEventListener("click", () => wake());
    for (let index = 0; ; index = (index + 1) % this.shot.length) {
      if (this.step && this.method !== method.value) await this.load();
      await this.#show(index);
      const pauseOver = new Promise((resolve) => {
        wake = resolve;
      });
      if (isPaused) await pauseOver;
      else await new Promise((resolve) => setTimeout(resolve, 30));
    }
  }

  /** @param {number} index of the frame */
  async #show(index) {
    const { shot, presenter, stage } = this, frame = await shot.frame(index);
    const exposure = this.meter.read(frame);
    let time = "not upscaled";
    presenter.jitter = frame.jitter;
    presenter.set("input", frame.size, frame.color.map((plane) => asFloat(plane).values), exposure);
    if (this.step) {
      const began = performance.now(), image = this.step.step(frame, exposure), plane = image.length / 3;
      time = `${(performance.now() - began).toFixed(0)} ms for the step`;
      presenter.set("ours", shot.displaySize, [0, 1, 2].map((i) => image.subarray(i * plane, (i + 1) * plane)), exposure);
    }
    presenter.views.delete("truth");
    const reference = await frame.reference();
    if (reference) presenter.set("truth", reference.size, reference.planes.map((part) => asFloat(part).values), exposure);
    presenter.present(stage.shown);
    performance.mark("first-image");
    document.getElementById("times").textContent = `frame ${index + 1} of ${shot.length}; ${time}${reference ? "" : "; this frame has no reference"}`;
  }
}
