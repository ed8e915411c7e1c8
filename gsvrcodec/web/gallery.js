/** The films of a directory, each with its first picture. */

import { Camera } from "./camera.js";
import { RemoteFilm } from "./remote_film.js";
import { Renderer } from "./renderer.js";
import { clockText, tauOf, Timeline } from "./timeline.js";

/** Longer side of the pictures, pixels. */
const SIDE = 440;

function makeEntry({ name, url, bytes }) {
  const entry = document.createElement("li");
  const link = entry.appendChild(document.createElement("a"));
  link.href = `player.html?film=${encodeURIComponent(url)}`;
  const canvas = link.appendChild(document.createElement("canvas"));
  link.appendChild(document.createElement("b")).textContent = name;
  const facts = link.appendChild(document.createElement("small"));
  facts.textContent = `${(bytes / 1e6).toFixed(2)} MB`;
  return { entry, canvas, facts };
}

/** Draw the first picture of a film, and tell its length and size. */
async function drawFirst(renderer, url, { canvas, facts }) {
  const film = new RemoteFilm();
  try {
    await film.open(new URL(url, location.href).href);
    const gop = await film.gop(0);
    const camera = new Camera(film.header);
    const scale = SIDE / Math.max(...camera.turned);
    const screen = camera.turned.map((side) => Math.max(1, Math.round(side * scale)));
    const source = renderer.gl.canvas;
    [source.width, source.height] = [canvas.width, canvas.height] = screen;
    const scene = renderer.scene(gop);
    renderer.clear();
    renderer.draw(scene, tauOf(0, gop.pts), camera.view(screen));
    canvas.getContext("2d").drawImage(source, 0, 0);
    scene.dispose();
    const { tick, end } = new Timeline(film.header, film.gops);
    const { width, height } = film.header;
    facts.textContent = `${clockText(end * tick)}, ${width}x${height}, ${facts.textContent}`;
  } catch (error) {
    facts.textContent = error.message;
  } finally {
    film.close();
  }
}

async function main() {
  const notice = document.getElementById("notice");
  try {
    const films = await (await fetch("films.json")).json();
    const renderer = new Renderer(document.createElement("canvas"));
    const entries = films.map((film) => [film, makeEntry(film)]);
    document.getElementById("films").append(...entries.map(([, { entry }]) => entry));
    for (const [{ url }, parts] of entries) await drawFirst(renderer, url, parts);
  } catch (error) {
    notice.textContent = error.message;
    notice.hidden = false;
  }
}

main();
