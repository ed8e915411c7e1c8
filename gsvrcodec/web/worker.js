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

async function answer({ id, method, args }) {
  try {
    const result = await (method === "open" ? open(...args) : film[method](...args));
    self.postMessage({ id, result });
  } catch ({ message, recoverable = false }) {
    self.postMessage({ id, error: { message, recoverable } });
  }
}

async function open(from, options) {
  film = await Film.open(await openSource(from), options);
  const { header, gops, origin, warnings } = film;
  return { header, gops, origin, warnings };
}
