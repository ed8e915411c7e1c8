/** The page: its elements by their id. */

export const page = Object.fromEntries(
  [...document.querySelectorAll("[id]")].map((each) => [each.id, each]));
