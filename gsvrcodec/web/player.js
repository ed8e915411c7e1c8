/** The page: controls, keys and touches of the player. */

import { Camera } from "./camera.js";
import { Gestures } from "./gestures.js";
import { Pace } from "./pace.js";
import { RemoteFilm } from "./remote_film.js";
import { openSound } from "./sound.js";
import { Stage } from "./stage.js";
import { clockText, Timeline } from "./timeline.js";

const LEAP_SECONDS = 5;
const ZOOM_STEP = 1.25;
const HIDE_AFTER = 2500;
/** Milliseconds between two readings of the clock while the film plays: to show it costs time. */
const CLOCK_STEP = 100;

/** Elements of the page by their id. */
const page = Object.fromEntries([...document.querySelectorAll("[id]")].map((each) => [each.id, each]));

class Player {
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
      this.say(error.message, error.recoverable && (() => this.open(from, name, { keepGoing: true })));
      return;
    }
    await this.openRest(film);
  }

  /** Fetch what the first picture can do without. */
  async openRest(film) {
    try {
      await film.gop(0);
    } catch {
      // It is told when the picture is drawn.
    }
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

  /** Show one sentence over the picture; `recover` is what its button does, if it has one. */
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

  /** One frame of the screen. */
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
    const frame = this.isBetween ? 0 : (1000 * this.timeline.frame * this.timeline.tick) / this.speed;
    return Math.min(Math.max(frame * 0.9, 33), 60);
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
    if (state === "drawn") this.drew(detail);
    this.say(state === "fault" ? this.stage.fault : "");
    if (this.isPlaying || this.pace.isAtRest) this.stage.prepare(this.stage.index, this.isBetween);
    page.picture.classList.toggle("movable", this.camera.zoom > 1);
  }

  drew(detail) {
    const { index, frame, tau, next } = this.stage.shown;
    this.pace.drew(detail);
    page.picture.dataset.moment = `${index} ${frame} ${tau} ${next}`;
  }

  /** Return the pixels to render for the screen. */
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
    page.seek.value = this.time;
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
      ...(this.warning ? [this.warning] : []),
    ].join(" \u00b7 ");
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

/** Change a choice by some places. */
function choose(select, places, wrap = false) {
  const { length } = select.options;
  const wanted = select.selectedIndex + places;
  select.selectedIndex = wrap ? wanted % length : Math.min(Math.max(wanted, 0), length - 1);
  select.dispatchEvent(new Event("change"));
}

function toggle(button) {
  button.setAttribute("aria-pressed", button.getAttribute("aria-pressed") !== "true");
}

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else document.documentElement.requestFullscreen?.().catch(() => {});
}

/** Give every control and key its meaning. */
function connect(player) {
  const actions = {
    play: () => player.setPlaying(!player.isPlaying),
    back: () => player.step(-1),
    forward: () => player.step(1),
    loop: () => toggle(page.loop),
    mute: () => { toggle(page.mute); player.hear(); },
    full: fullScreen,
    help: () => page.keys.showModal(),
    smaller: () => player.zoom(1 / ZOOM_STEP),
    larger: () => player.zoom(ZOOM_STEP),
    fit: () => player.zoom(0),
  };
  for (const [id, action] of Object.entries(actions)) page[id].onclick = action;
  for (const choice of [page.speed, page.between, page.layers, page.outlines]) {
    choice.addEventListener("change", () => { player.redraw(); player.hear(); });
  }
  page.seek.oninput = () => player.seek(Number(page.seek.value));
  page.open.onchange = () => {
    const [file] = page.open.files;
    if (file) player.open(file, file.name);
  };

  const keys = {
    " ": actions.play,
    k: actions.play,
    ArrowLeft: () => player.leap(-LEAP_SECONDS),
    ArrowRight: () => player.leap(LEAP_SECONDS),
    ArrowUp: () => player.sound?.changeVolume(0.1),
    ArrowDown: () => player.sound?.changeVolume(-0.1),
    ",": actions.back,
    ".": actions.forward,
    Home: () => player.seek(0),
    End: () => player.film && player.seek(player.film.gops?.at(-1).end),
    "[": () => choose(page.speed, -1),
    "]": () => choose(page.speed, 1),
    "+": actions.larger,
    "=": actions.larger,
    "-": actions.smaller,
    0: actions.fit,
    v: () => choose(page.layers, 1, true),
    g: () => page.outlines.click(),
    l: actions.loop,
    m: actions.mute,
    f: actions.full,
    o: () => page.open.click(),
    "?": actions.help,
  };
  document.addEventListener("keydown", (event) => {
    const { target, key } = event;
    if (event.ctrlKey || event.altKey || event.metaKey || page.keys.open) return;
    // A focused control keeps the keys that work it.
    const isChoice = target instanceof HTMLSelectElement;
    const isPress = target instanceof HTMLButtonElement || target.type === "checkbox";
    if (isChoice || (isPress && key === " ") || !Object.hasOwn(keys, key)) return;
    event.preventDefault();
    keys[key]();
  });

  new Gestures(page.picture, {
    tap: actions.play,
    drag: (distance) => player.pan(distance),
    zoom: (place, factor) => player.zoom(factor, place),
  });
  page.picture.addEventListener("dblclick", fullScreen);
  page.picture.addEventListener("webglcontextlost", (event) => event.preventDefault());
  page.picture.addEventListener("webglcontextrestored", () => {
    player.stage.restore();
    player.pace = new Pace(player.stage.renderer.gl);
    player.redraw();
  });

  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    const [file] = event.dataTransfer.files;
    if (file) player.open(file, file.name);
  });
  new ResizeObserver(() => player.redraw()).observe(page.theatre);
  setInterval(() => player.showFacts(), 250);
  hideControls(player);
}

/** Hide the controls of a film that plays on the full screen until something is touched. */
function hideControls(player) {
  let timer = 0;
  const wake = () => {
    document.body.classList.remove("idle");
    clearTimeout(timer);
    timer = setTimeout(() => {
      const isIdle = document.fullscreenElement && player.isPlaying;
      document.body.classList.toggle("idle", Boolean(isIdle));
    }, HIDE_AFTER);
  };
  for (const event of ["pointermove", "pointerdown", "keydown"]) {
    document.addEventListener(event, wake);
  }
}

/** Return the last part of an address, to be read. */
function nameOf(address) {
  const name = address.split("/").at(-1);
  try {
    return decodeURIComponent(name);
  } catch {
    return name;
  }
}

/** Open the film in the page's text, or else the one that its address names. */
function openFirst(player) {
  const inside = document.getElementById("film");
  const address = new URLSearchParams(location.search).get("film");
  if (inside) {
    const text = atob(inside.textContent);
    const bytes = new Uint8Array(text.length);
    for (let n = 0; n < bytes.length; n++) bytes[n] = text.charCodeAt(n);
    player.open(new Blob([bytes]), inside.dataset.name);
  } else if (address) {
    player.open(new URL(address, location.href).href, nameOf(address));
  } else {
    player.say("Open a .gsvr film, or drop one here.");
  }
}

function main() {
  let player;
  try {
    player = new Player();
  } catch (error) {
    page.sentence.textContent = error.message;
    page.notice.hidden = false;
    return;
  }
  connect(player);
  openFirst(player);
}

main();
