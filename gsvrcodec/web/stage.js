/** The canvas: draws the picture of any time, at the size that the device has time for. */

import { mix } from "./prediction.js";
import { Renderer } from "./renderer.js";
import { View } from "./view.js";

/** GOPs and passages that are kept on the device. */
const SCENES = 4;
/** Codes by which pictures differ in the mean if a cut lies between them. */
const CUT = 25.5;
/** Columns of these pictures. */
const CUT_WIDTH = 64;

export class Stage {
  scenes = new Map(); // by key, the one used longest ago first

  /** `changed` is called when a missing GOP has come. */
  constructor(canvas, changed) {
    this.canvas = canvas;
    this.changed = changed;
    this.renderer = new Renderer(canvas);
    this.film = this.timeline = this.camera = null;
    this.reset();
  }

  /** Show another film, with its timeline and its camera. */
  load(film, timeline, camera) {
    this.reset();
    Object.assign(this, { film, timeline, camera });
  }

  reset() {
    this.clear();
    this.loading = new Set();
    this.faults = new Map();
    this.cuts = new Map();
    this.shown = null;
    this.index = 0;
  }

  clear() {
    for (const { scene } of this.scenes.values()) scene.dispose();
    this.scenes.clear();
    this.picture = ""; // key of the picture on the screen
  }

  /** Start anew on a device that was lost. */
  restore() {
    this.scenes.clear();
    this.renderer = new Renderer(this.canvas);
    this.reset();
  }

  /** Return a GOP or passage on the device; undefined while it is loaded. */
  at(key, load) {
    const found = this.scenes.get(key);
    if (found) {
      this.scenes.delete(key);
      this.scenes.set(key, found);
      return found;
    }
    if (!this.loading.has(key) && !this.faults.has(key)) this.fetch(key, load);
    return undefined;
  }

  async fetch(key, load) {
    const { film } = this;
    this.loading.add(key);
    try {
      const content = await load();
      if (film !== this.film) return;
      this.keep(key, content);
    } catch (error) {
      if (film !== this.film) return;
      this.faults.set(key, error.message);
    }
    this.loading.delete(key);
    this.changed();
  }

  /** Take out what moves at a place of the screen, pixels; return its number of Gaussians. */
  async takeOut(place) {
    if (!this.shown) return 0;
    const { index, tau, view } = this.shown;
    const inFrame = view.pixelAt(place).map((at, axis) => 2 * at / view.frame[axis] - 1);
    const count = await this.film.takeOut(index, tau, inFrame);
    this.refresh();
    return count;
  }

  async bringBack() {
    await this.film.bringBack();
    this.refresh();
  }

  /** Ask for all GOPs anew. */
  refresh() {
    this.clear();
    this.changed();
  }

  keep(key, content) {
    this.scenes.set(key, { ...content, scene: this.renderer.scene(content) });
    for (const [oldest, { scene }] of [...this.scenes].slice(0, -SCENES)) {
      scene.dispose();
      this.scenes.delete(oldest);
    }
  }

  gop(index) {
    return this.at(`gop ${index}`, () => this.film.gop(index));
  }

  /** Return the passage to the GOP that is predicted from this one. */
  passage(index) {
    return this.at(`passage ${index}`, async () => {
      const passage = await this.film.passage(index);
      return { ...passage, gaussians: passage.from.slice(), grids: null };
    });
  }

  /** Load the next GOP and the passage to it early; `between` as in `show`. */
  prepare(index, between) {
    if (index + 1 >= this.film.gops.length) return;
    this.gop(index + 1);
    if (between && this.film.gops[index + 1].reference === index) this.passage(index);
  }

  /**
   * Draw the picture of a time, ticks. Return "drawn", "same" (it is there), "loading" (nothing was
   * drawn) or "fault". `options`: `between` (frames), `layers`, `outlines`, `screen` (pixels).
   */
  show(time, options) {
    const index = this.timeline.gopAt(time);
    this.index = index;
    const gop = this.gop(index);
    if (!gop) return this.faults.has(`gop ${index}`) ? this.showFault(index) : "loading";
    const moment = this.timeline.moment(time, index, gop.pts, options.between);
    const parts = this.parts(moment, gop);
    if (!parts) return "loading";
    const view = this.camera.view(options.screen);
    const { tau, next } = moment;
    const { left, top, frame } = view;
    const { layers, outlines, screen } = options;
    const picture = [index, tau, next, left, top, frame, layers, outlines, screen].join();
    if (picture === this.picture) return "same";
    this.picture = picture;
    const { canvas, renderer } = this;
    if (canvas.width !== screen[0] || canvas.height !== screen[1]) {
      [canvas.width, canvas.height] = screen;
    }
    renderer.clear();
    for (const part of parts) {
      renderer.draw(part.scene, part.tau, view, { layers, opacity: part.opacity });
    }
    if (outlines) renderer.drawOutlines(parts[0].scene, parts[0].tau, view, { layers });
    this.shown = { ...moment, scene: parts[0].scene, view };
    return "drawn";
  }

  showFault(index) {
    this.renderer.clear();
    this.shown = null;
    this.picture = "";
    this.fault = this.faults.get(`gop ${index}`);
    return "fault";
  }

  /** Return the scenes of a moment with their times and weights; null while one is loaded. */
  parts({ index, tau, next }, gop) {
    const alone = [{ scene: gop.scene, tau, opacity: 1 }];
    if (next === 0) return alone;
    if (this.film.gops[index + 1].reference === index) {
      const passage = this.passage(index);
      if (!passage) return this.faults.has(`passage ${index}`) ? alone : null;
      mix(passage, next, passage.gaussians);
      passage.scene.replace(passage.gaussians);
      return [{ scene: passage.scene, tau: 0, opacity: 1 }];
    }
    const following = this.gop(index + 1);
    if (!following) return this.faults.has(`gop ${index + 1}`) ? alone : null;
    const first = following.pts.length > 1 ? -1 : 0;
    if (this.isCut(index, gop.scene, tau, following.scene, first)) return alone;
    return [...alone, { scene: following.scene, tau: first, opacity: next }];
  }

  /** Return whether a cut lies between two pictures (section 8.1). */
  isCut(index, scene, tau, following, first) {
    if (!this.cuts.has(index)) {
      const a = this.thumbnail(scene, tau), b = this.thumbnail(following, first);
      const sum = a.reduce((total, code, n) => total + Math.abs(code - b[n]), 0);
      this.cuts.set(index, sum / (a.length * 0.75) > CUT); // every fourth code is the opacity
    }
    return this.cuts.get(index);
  }

  /** Draw a small picture into a corner of the screen; return its codes. */
  thumbnail(scene, tau) {
    const { width, height } = this.film.header;
    const screen = [this.canvas.width, this.canvas.height];
    const side = Math.min(CUT_WIDTH, ...screen);
    const frame = [side, Math.min(Math.max(1, Math.round((side * height) / width)), screen[1])];
    this.renderer.clear();
    this.renderer.draw(scene, tau, new View({ coded: [width, height], frame, screen }));
    return this.renderer.read(0, screen[1] - frame[1], ...frame);
  }
}
