/** The page's side of the film: a worker reads and unpacks it. */

import { GsvrError } from "./errors.js";

/** GOPs that are kept at hand. */
const KEPT = 4;

/** Start the worker: of this page's text if it has one, else of the file beside it. */
function startWorker() {
  const text = document.getElementById("worker");
  if (!text) return new Worker("worker.js", { type: "module" });
  const url = URL.createObjectURL(new Blob([text.textContent], { type: "text/javascript" }));
  const worker = new Worker(url);
  URL.revokeObjectURL(url);
  return worker;
}

/** A film in a worker. Methods are those of `Film`, and reject with a `GsvrError`. */
export class RemoteFilm {
  constructor() {
    this.worker = startWorker();
    this.waiting = new Map();
    this.requests = 0;
    this.header = this.gops = this.origin = null; // as of `Film`; null until it is open
    this.warnings = [];
    this.gopsAtHand = new Map(); // by number, the one used longest ago first
    this.plate = null; // the last one
    this.worker.onmessage = ({ data: { id, result, error } }) => {
      const { resolve, reject } = this.waiting.get(id);
      this.waiting.delete(id);
      if (error) reject(Object.assign(new GsvrError(), error));
      else resolve(result);
    };
    this.worker.onerror = (event) => {
      event.preventDefault();
      this.fail(new GsvrError("The decoder does not start in this browser; it may be too old."));
    };
  }

  fail(failure) {
    for (const { reject } of this.waiting.values()) reject(failure);
    this.waiting.clear();
  }

  call(method, ...args) {
    return new Promise((resolve, reject) => {
      const id = this.requests++;
      this.waiting.set(id, { resolve, reject });
      this.worker.postMessage({ id, method, args });
    });
  }

  /** Open a Blob or a URL; set `header`, `gops`, `origin`, `warnings`. */
  async open(from, options) {
    Object.assign(this, await this.call("open", from, options));
  }

  /** Return the promise of a GOP, which is unpacked once while it is at hand. */
  gop(index) {
    const found = this.gopsAtHand.get(index) ?? this.withPlate("gop", index);
    found.catch(() => this.gopsAtHand.delete(index));
    this.gopsAtHand.delete(index);
    this.gopsAtHand.set(index, found);
    const unused = [...this.gopsAtHand.keys()].slice(0, -KEPT);
    unused.forEach((old) => this.gopsAtHand.delete(old));
    return found;
  }

  /** Return a GOP or a passage with its plate, which is asked for once in a chain. */
  async withPlate(method, index) {
    const found = await this.call(method, index);
    if (found.plate === undefined) return found;
    if (found.plate !== this.plate?.number) this.plate = await this.call("plate", index);
    return { ...found, plate: this.plate };
  }

  passage(index) {
    return this.withPlate("passage", index);
  }

  /** GOPs have to be asked for anew. */
  takeOut(index, tau, place) {
    this.gopsAtHand.clear();
    return this.call("takeOut", index, tau, place);
  }

  bringBack() {
    this.gopsAtHand.clear();
    return this.call("bringBack");
  }

  sounds() {
    return this.call("sounds");
  }

  metadata() {
    return this.call("metadata");
  }

  close() {
    this.worker.terminate();
    this.fail(new GsvrError("The film was closed."));
  }
}
