/** Gives controls, keys and touches their meaning, and opens the first film. */

import { Gestures } from "./gestures.js";
import { page } from "./page.js";
import { Player } from "./playback.js";

const LEAP_SECONDS = 5;
const ZOOM_STEP = 1.25;
/** Milliseconds without a touch until the controls of a full screen hide. */
const HIDE_AFTER = 2500;

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
    remove: () => setRemoving(!isRemoving()),
  };
  const isRemoving = () => page.remove.getAttribute("aria-pressed") === "true";
  const setRemoving = (wanted) => {
    page.remove.setAttribute("aria-pressed", wanted);
    page.picture.classList.toggle("removing", wanted);
    if (!wanted) player.bringBack();
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
    x: actions.remove,
    Escape: () => setRemoving(false),
    "?": actions.help,
  };
  document.addEventListener("keydown", (event) => {
    const { target, key } = event;
    if (event.ctrlKey || event.altKey || event.metaKey || page.keys.open) return;
    // A focused control keeps the keys that work it.
    const isChoice = target instanceof HTMLSelectElement;
    const isPress = target instanceof HTMLButtonElement || target === page.outlines;
    if (isChoice || (isPress && key === " ") || !Object.hasOwn(keys, key)) return;
    event.preventDefault();
    keys[key]();
  });

  new Gestures(page.picture, {
    tap: (place) => (isRemoving() ? player.takeOut(place) : actions.play()),
    drag: (distance) => player.pan(distance),
    zoom: (place, factor) => player.zoom(factor, place),
  });
  page.picture.addEventListener("dblclick", () => isRemoving() || fullScreen());
  page.picture.addEventListener("webglcontextlost", (event) => event.preventDefault());
  page.picture.addEventListener("webglcontextrestored", () => player.restore());

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

/** Hide the controls while a film plays on the full screen and nothing is touched. */
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

/** Return the last part of an address. */
function nameOf(address) {
  const name = address.split("/").at(-1);
  try {
    return decodeURIComponent(name);
  } catch {
    return name;
  }
}

/** Open the film in the page, or the one that its address names. */
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
