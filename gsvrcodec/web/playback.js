/** A film while it plays: its time, its speed, and the picture on the screen. */

import { Camera } from "./camera.js";
import { Pace } from "./pace.js";
import { page } from "./page.js";
import { RemoteFilm } from "./remote_film.js";
import { openSound } from "./sound.js";
import { Stage } from "./stage.js";
import { clockText, Timeline } from "./timeline.js";

/** Milliseconds between showings of the time. */
const CLOCK_STEP = 100;

export class Player {
  constructor() {
    this.stage = new Stage(page.picture, () => this.redraw());
    this.pace = new Pace(this.stage.renderer.gl);
    this.film = null;
    this.sound = null;
    this.said = null;
    this.time = 0; // ticks after the first timestamp
    this.isPlaying = false;
    this.isLate = false;
    this.isDirty = false;
    this.last = 0; // milliseconds of the screen's clock
    this.clockRead = 0;
    requestAnimationFrame((now) => this.frame(now));
  }

  /** Open a Blob or a URL. */
  async open(from, name, options = {}) {
    this.close();
    const film = new RemoteFilm();
    this.film = film;
    page.wait.hidden = false;
    try {
      await film.open(from, options);
      if (film !== this.film) return;
      this.start(film, name);
    } catch (error) {
      if (film !== this.film) return;
      page.wait.hidden = true;
      const recover = () => this.open(from, name, { keepGoing: true });
      this.say(error.message, error.recoverable ? recover : null);
      return;
    }
    await this.openRest(film);
  }

  /** Fetch what the first picture can do without. */
  async openRest(film) {
    await film.gop(0).catch(() => {}); // told when the picture is drawn
    try {
      const { film: { title } = {} } = await film.metadata();
      if (film === this.film && title) document.title = `${title} - gsvrplay`;
      const sound = await openSound(film);
      if (film !== this.film) return sound?.close();
      this.sound = sound;
      page.mute.hidden = !sound;
    } catch (error) {
      if (film === this.film) this.warning ||= error.message;
    }
  }

  start(film, name) {
    document.title = `${name} - gsvrplay`;
    this.timeline = new Timeline(film.header, film.gops);
    this.camera = new Camera(film.header);
    this.stage.load(film, this.timeline, this.camera);
    page.seek.disabled = false;
    page.seek.max = this.timeline.end;
    this.warning = film.warnings[0] ?? "";
    this.remark = "";
    this.seek(film.gops[0].start);
  }

  close() {
    this.film?.close();
    this.sound?.close();
    this.film = this.sound = this.timeline = null;
    this.setPlaying(false);
    this.stage.reset();
    this.stage.renderer.clear();
    this.say("");
    delete page.picture.dataset.moment;
    page.seek.disabled = true;
    page.mute.hidden = true;
    page.facts.textContent = "";
  }

  /** Show a sentence over the picture; `recover` is what its button does, if it has one. */
  say(sentence, recover = null) {
    if (sentence === this.said) return;
    this.said = sentence;
    page.sentence.textContent = sentence;
    page.notice.hidden = !sentence;
    page.recover.hidden = !recover;
    page.recover.onclick = recover || null;
  }

  redraw() {
    this.isDirty = true;
  }

  restore() {
    this.stage.restore();
    this.pace = new Pace(this.stage.renderer.gl);
    this.redraw();
  }

  /** Go to a time, ticks. */
  seek(time) {
    if (!this.timeline) return;
    this.time = Math.min(Math.max(time, 0), this.timeline.end);
    this.sound?.jump();
    this.stage.faults.clear(); // the network may be back
    this.pace.touch();
    this.redraw();
    this.showTime();
  }

  leap(seconds) {
    if (this.timeline) this.seek(this.time + seconds / this.timeline.tick);
  }

  /** Go to the next frame (1) or to the one before (-1). */
  async step(direction) {
    if (!this.timeline) return;
    this.setPlaying(false);
    const { film, time } = this;
    const index = this.timeline.gopAt(time);
    const gop = await film.gop(index).catch(() => ({ pts: [0] }));
    if (film !== this.film || time !== this.time) return;
    const wanted = this.timeline.neighbour(time, index, gop.pts, direction);
    if (wanted !== null) this.seek(wanted);
  }

  setPlaying(isPlaying) {
    if (isPlaying && !this.timeline) return;
    if (isPlaying && this.time >= this.film.gops.at(-1).end) this.seek(0);
    this.isPlaying = isPlaying;
    page.play.setAttribute("aria-pressed", isPlaying);
    page.play.setAttribute("aria-label", isPlaying ? "Pause" : "Play");
    this.pace.touch();
    this.redraw();
    this.hear();
  }

  get speed() {
    return Number(page.speed.value);
  }

  get isBetween() {
    return page.between.value === "always" || (page.between.value === "slow" && this.speed < 1);
  }

  /** Let the sound follow the pictures, or stop. */
  hear() {
    if (!this.sound || !this.timeline) return;
    this.sound.muted = page.mute.getAttribute("aria-pressed") === "true";
    const audible = this.isPlaying && this.speed === 1 && !this.isLate;
    const { tick } = this.timeline;
    const { origin } = this.film;
    this.time = this.sound.follow((this.time + origin) * tick, audible) / tick - origin;
  }

  /** A frame of the screen. */
  frame(now) {
    requestAnimationFrame((next) => this.frame(next));
    const passed = Math.min((now - this.last) / 1000, 0.25);
    this.last = now;
    if (!this.timeline) return;
    if (this.isPlaying && !this.isLate) this.advance(passed);
    const budget = this.isPlaying ? this.budget() : 50;
    if (this.pace.isBusy(budget)) return;
    if (this.isPlaying || this.isDirty || !this.isFull) this.draw();
  }

  /** Milliseconds that a picture may take while the film plays. */
  budget() {
    if (this.isBetween) return 50;
    const { frame, tick } = this.timeline;
    return Math.min(Math.max((900 * frame * tick) / this.speed, 33), 60);
  }

  advance(passed) {
    this.time += (passed * this.speed) / this.timeline.tick;
    this.hear();
    if (this.time >= this.timeline.end) {
      if (page.loop.getAttribute("aria-pressed") === "true") {
        this.seek(0);
      } else {
        this.setPlaying(false);
        this.seek(this.film.gops.at(-1).end);
      }
    }
    if (this.last - this.clockRead > CLOCK_STEP) this.showTime();
  }

  draw() {
    const full = this.screen(1);
    const detail = this.pace.next(full, this.isPlaying);
    const state = this.stage.show(this.time, {
      between: this.isBetween,
      layers: page.layers.value,
      outlines: page.outlines.checked,
      screen: this.screen(detail),
    });
    this.isLate = state === "loading";
    page.wait.hidden = !this.isLate;
    if (this.isLate) return;
    this.isDirty = false;
    this.isFull = detail === 1;
    if (state === "drawn") {
      const { index, frame, tau, next } = this.stage.shown;
      this.pace.drew(detail);
      page.picture.dataset.moment = `${index} ${frame} ${tau} ${next}`;
    }
    this.say(state === "fault" ? this.stage.fault : "");
    if (this.isPlaying || this.pace.isAtRest) this.stage.prepare(this.stage.index, this.isBetween);
    page.picture.classList.toggle("movable", this.camera.zoom > 1);
  }

  /** Return the pixels to render. */
  screen(detail) {
    const { width, height } = page.theatre.getBoundingClientRect();
    const scale = (window.devicePixelRatio || 1) * detail;
    return [width, height].map((side) => Math.max(1, Math.round(side * scale)));
  }

  showTime() {
    this.clockRead = this.last;
    const { tick, end } = this.timeline;
    const text = `${clockText(this.time * tick)} / ${clockText(end * tick)}`;
    page.time.textContent = text;
    page.seek.value = String(this.time);
    page.seek.setAttribute("aria-valuetext", text);
  }

  showFacts() {
    if (!this.timeline) return;
    const { shown } = this.stage;
    if (!shown) return;
    const { gops, header } = this.film;
    const gop = gops[shown.index];
    const { count, moving } = shown.scene;
    const drawn = { all: count, moving, standing: count - moving }[page.layers.value];
    page.facts.textContent = [
      `${this.pace.rate} pictures/s`,
      `frame ${gop.firstFrame + shown.frame}`,
      `GOP ${shown.index + 1} of ${gops.length}${gop.reference === -1 ? "" : ", predicted"}`,
      `${drawn.toLocaleString("en")} Gaussians, ${moving.toLocaleString("en")} move`,
      `${Math.round(this.timeline.bitRate(shown.index) / 1000).toLocaleString("en")} kbit/s`,
      `${header.width}x${header.height} at ${shown.view.frame.join("x")}`,
      ...[this.remark, this.warning].filter(Boolean),
    ].join(" \u00b7 ");
  }

  async takeOut(place) {
    const { film } = this, scale = page.picture.width / page.picture.clientWidth;
    if (!film) return;
    const count = await this.stage.takeOut(place.map((at) => at * scale)).catch(() => 0);
    if (film !== this.film) return;
    this.remark = count ? `${count.toLocaleString("en")} taken out` : "nothing moves there";
  }

  bringBack() {
    this.remark = "";
    if (this.film) this.stage.bringBack().catch(() => {}); // which fails if the film was closed
  }

  zoom(factor, place = null) {
    if (!this.camera) return;
    const screen = [page.picture.clientWidth, page.picture.clientHeight];
    if (factor === 0) this.camera.reset();
    else this.camera.zoomAt(place ?? screen.map((side) => side / 2), factor, screen);
    this.pace.touch();
    this.redraw();
  }

  pan(distance) {
    if (!this.camera) return;
    this.camera.moveBy(distance, [page.picture.clientWidth, page.picture.clientHeight]);
    this.pace.touch();
    this.redraw();
  }
}
