/**
 * The part of the page that shows two views: which they are, the split between them, and the zoom.
 * Calls its `onChange` after each change.
 */

const STEP_OF_KEY = 0.02, LARGEST_ZOOM = 8;

export class Stage {
  /** @param {HTMLElement} root with a canvas, two selects and a slider */
  constructor(root) {
    this.root = root;
    /** @type {() => void} */ this.onChange = () => {};
    this.canvas = root.querySelector("canvas");
    this.slider = /** @type {HTMLElement} */ (root.querySelector("[role=slider]"));
    const [left, right] = root.querySelectorAll("select");
    this.selects = { left, right };
    /** @type {import("./presenter.js").Shown} */
    this.shown = { left: "input", right: "ours", split: 0.5, zoom: 1, origin: [0, 0] };
    this.#listen();
    this.setSplit(0.5);
  }

  /** @param {number} split 0 to 1 */
  setSplit(split) {
    this.shown.split = Math.min(Math.max(split, 0), 1);
    this.slider.style.left = `${100 * this.shown.split}%`;
    this.slider.setAttribute("aria-valuenow", String(Math.round(100 * this.shown.split)));
    this.onChange();
  }

  /** @param {"left" | "right"} side @param {string} view one of VIEWS */
  setView(side, view) {
    this.shown[side] = this.selects[side].value = view;
    this.onChange();
  }

  /** @param {[number, number]} size width and height of the images */
  setSize([width, height]) {
    Object.assign(this.canvas, { width, height });
    this.root.style.aspectRatio = `${width} / ${height}`;
    Object.assign(this.shown, { zoom: 1, origin: [0, 0] });
  }

  /** @param {string} name of the view "truth": native or reference */
  nameTruth(name) {
    for (const option of this.root.querySelectorAll("option[value=truth]")) option.textContent = name;
  }

  /** @param {string} view @returns {boolean} */
  shows(view) {
    return this.shown.left === view || this.shown.right === view;
  }

  #listen() {
    for (const [side, select] of Object.entries(this.selects)) {
      select.value = this.shown[side];
      select.addEventListener("change", () => this.setView(side, select.value));
      select.addEventListener("pointerdown", (event) => event.stopPropagation());
    }
    this.root.addEventListener("pointerdown", (event) => {
      this.root.setPointerCapture(event.pointerId);
      this.setSplit(this.#at(event)[0]);
    });
    this.root.addEventListener("pointermove", (event) => {
      if (event.buttons) this.setSplit(this.#at(event)[0]);
    });
    this.slider.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -STEP_OF_KEY, ArrowRight: STEP_OF_KEY }[event.key];
      if (step) this.setSplit(this.shown.split + step);
    });
    this.root.addEventListener("wheel", (event) => {
      event.preventDefault();
      if (event.deltaY) this.#zoomAt(this.#at(event), event.deltaY < 0 ? 2 : 0.5);
    }, { passive: false });
  }

  /** @param {MouseEvent} event @returns {[number, number]} place in the canvas, 0 to 1 */
  #at(event) {
    const box = this.canvas.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  }

  /** Keeps the image pixel under the pointer where it is. @param {[number, number]} place @param {number} factor */
  #zoomAt(place, factor) {
    const { shown, canvas } = this, before = shown.zoom, size = [canvas.width, canvas.height];
    shown.zoom = Math.min(Math.max(before * factor, 1), LARGEST_ZOOM);
    shown.origin = shown.origin.map((corner, axis) => {
      const wanted = corner + place[axis] * size[axis] * (1 / before - 1 / shown.zoom);
      return Math.min(Math.max(wanted, 0), size[axis] * (1 - 1 / shown.zoom));
    });
    this.onChange();
  }
}
