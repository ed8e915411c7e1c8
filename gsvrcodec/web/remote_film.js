/** The page's side of the film: a worker reads and unpacks it. */

import { GsvrError } from "./errors.js";

/** Bytes of unpacked GOPs that are kept at hand. */
const KEPT_BYTES = 64 * 2 ** 20;

/** Start the worker: of this page's text if it has one, else of the file beside it. */
function startWorker() {
  const text = document.getElementById("worker");
  if (!text) return new Worker("worker.js", { type: "module" });
  const url = URL.createObjectURL(new Blob([text.textContent], { type: "text/javascript" }));
  const worker = new Worker(url);
  URL.revokeObjectURL(url);
  return worker;
}

/** A film in a worker. Methods reject with a `GsvrError` that holds one sentence. */
export class RemoteFilm {
  constructor() {
    this.worker = startWorker();
    this.waiting = new Map();
    this.requests = 0;
    this.header = this.gops = this.origin = null; // as of `Film`; null until it is open
    this.warnings = [];
    this.gopsAtHand = new Map(); // by number, the one used longest ago first
    this.worker.onmessage = ({ data: { id, result, error } }) => {
      const { resolve, reject } = this.waiting.get(id);
      this.waiting.delete(id);
      if (!error) return resolve(result);
      const failure = new GsvrError(error.message);
      failure.recoverable = error.recoverable;
      return reject(failure);
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
    let found = this.gopsAtHand.get(index);
    if (!found) {
      found = this.call("gop", index);
      found.then((gop) => this.forget(gop), () => this.gopsAtHand.delete(index));
    }
    this.gopsAtHand.delete(index);
    this.gopsAtHand.set(index, found);
    return found;
  }

  /** Drop GOPs that were not used for long, for a new one. */
  forget(gop) {
    const room = Math.max(2, Math.floor(KEPT_BYTES / (gop.gaussians.byteLength + 1)));
    for (const index of [...this.gopsAtHand.keys()].slice(0, -Math.min(room, 16))) {
      this.gopsAtHand.delete(index);
    }
  }

  passage(index) {
    return this.call("passage", index);
  }

  /** Take out what moves at a place, as `Film.takeOut`; GOPs have to be asked for anew. */
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
