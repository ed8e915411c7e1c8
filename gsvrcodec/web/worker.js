/** The decoder in a Web Worker: answers requests one after the other, but for sounds. */

import { Film } from "./film.js";
import { openSource } from "./source.js";

let film = null;
let queue = Promise.resolve();

/** `{ id, method, args }` is answered by `{ id, result }` or `{ id, error }`. */
self.onmessage = ({ data }) => {
  // Sound may take long to come, and no GOP waits for it.
  if (data.method === "sounds") answer(data);
  else queue = queue.then(() => answer(data));
};

async function answer({ id, method, args = [] }) {
  try {
    const result = copied(await (method === "open" ? open(...args) : film[method](...args)));
    self.postMessage({ id, result }, buffersOf(result));
  } catch ({ name, message, recoverable = false }) {
    self.postMessage({ id, error: { name, message, recoverable } });
  }
}

async function open(from, options) {
  const source = await openSource(from);
  film = await Film.open(source, options);
  const { header, gops, origin, warnings } = film;
  return { header, gops, origin, warnings, size: source.size };
}

/** Copy the arrays in a result, for those that are sent are lost to the sender. */
function copied(value) {
  if (ArrayBuffer.isView(value)) return /** @type {Uint8Array} */ (value).slice();
  if (Array.isArray(value)) return value.map(copied);
  if (typeof value !== "object" || value === null) return value;
  return Object.fromEntries(Object.entries(value).map(([key, part]) => [key, copied(part)]));
}

function buffersOf(value) {
  if (ArrayBuffer.isView(value)) return [value.buffer];
  return typeof value === "object" && value !== null ? Object.values(value).flatMap(buffersOf) : [];
}
