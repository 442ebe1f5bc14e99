/**
 * The page: the scene or a shot, upscaled on WebGPU; without WebGPU, a shot by the CPU library.
 * `?test` in the address: nothing starts by itself, and `window.supersamplerDemo` steps and reads images.
 * `?source=shot&method=taau&ratio=3&size=640x360&left=bilinear&right=truth` sets the controls.
 */

import { startFallback } from "./page/fallback.js";
import { runGpuPage } from "./page/gpu_page.js";
import { VIEWS } from "./page/presenter.js";
import { Stage } from "./page/stage.js";

const form = /** @type {HTMLFormElement} */ (document.getElementById("controls"));
const note = document.getElementById("note");
const query = new URLSearchParams(location.search);

/** @param {string} text "" hides the note */
function say(text) {
  note.textContent = text;
  note.hidden = !text;
}

say("");
const stage = new Stage(document.getElementById("stage"));
for (const [name, value] of query) {
  const control = form.elements.namedItem(name);
  if (control) control.value = value;
  if (control?.selectedIndex < 0) control.selectedIndex = 0; // no such choice
}
for (const side of ["left", "right"]) {
  if (VIEWS.includes(query.get(side))) stage.setView(side, query.get(side));
}
try {
  await runGpuPage({ form, stage, say, query });
} catch (error) {
  console.info(error);
  await startFallback(error.message, { form, stage, say });
}
