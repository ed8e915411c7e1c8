/** The page: its elements by their id. */

/**
 * @typedef {Object} Controls
 * @property {HTMLCanvasElement} picture
 * @property {HTMLInputElement} seek
 * @property {HTMLInputElement} open
 * @property {HTMLInputElement} outlines
 * @property {HTMLSelectElement} speed
 * @property {HTMLSelectElement} between
 * @property {HTMLSelectElement} layers
 * @property {HTMLButtonElement} play
 * @property {HTMLButtonElement} mute
 * @property {HTMLDialogElement} keys
 */

export const page = /** @type {Record<string, HTMLElement> & Controls} */ (Object.fromEntries(
  [...document.querySelectorAll("[id]")].map((each) => [each.id, each])));
