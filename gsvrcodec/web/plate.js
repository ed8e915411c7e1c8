/** Plates (section 5.7): still pictures, coded as AVIF, which the browser decodes. */

import { Cursor } from "./bytes.js";
import { readType } from "./chunks.js";
import { check } from "./errors.js";
import { allocate, limitExpansion } from "./limits.js";

const type = "image/avif";

/**
 * Decode a plate. Return its size and its `texels`, four bytes of each pixel: Y, Cb and Cr if
 * `isYcc`, else, from browsers that do not tell these, red, green and blue, rounded.
 */
export async function decodePlate(bytes, { width, height }) {
  const size = `${width}x${height}`;
  limitExpansion(width * height * 3 / 4, bytes.length);
  const traits = new Set(findTraits(new Cursor(bytes), ["meta", "iprp", "ipco"]));
  const right = traits.size === 2 && traits.has(size) && traits.has("0");
  check(right, `its plate is no AVIF picture of ${size} pixels, 8 bits and 4:4:4.`);
  const image = await decodeImage(bytes).catch(() => null), count = width * height;
  check(image, "its plate cannot be decoded.");
  const texels = allocate(Uint8Array, 4 * count), isYcc = image.format === "I444";
  if (isYcc) {
    check(image.colorSpace.fullRange, "its plate has no full range.");
    const planes = allocate(Uint8Array, 3 * count);
    const layout = [0, 1, 2].map((part) => ({ offset: part * count, stride: width }));
    await image.copyTo(planes, { layout });
    for (let n = 0; n < count; n++) {
      for (let part = 0; part < 3; part++) texels[4 * n + part] = planes[part * count + n];
    }
  } else {
    const context = new OffscreenCanvas(width, height).getContext("2d");
    context.drawImage(image, 0, 0);
    texels.set(context.getImageData(0, 0, width, height).data);
  }
  image.close();
  return { width, height, texels, isYcc };
}

/**
 * Yield the sizes of pictures, and "0" of 8 bits and 4:4:4, in boxes along a path of types. Numbers
 * are big-endian.
 */
function* findTraits(cursor, path) {
  const u32 = (from) => from.view.getUint32(from.skip(4));
  while (cursor.left) {
    const length = u32(cursor), box = readType(cursor);
    check(length === 0 || length >= 8, "its plate has a box of a wrong length.");
    const start = cursor.skip(length ? length - 8 : cursor.left);
    const inside = new Cursor(cursor.bytes, start, cursor.at);
    if (box === "meta" || box === "ispe") inside.skip(4); // version and flags
    if (box === path[0]) yield* findTraits(inside, path.slice(1));
    if (box === "ispe") yield `${u32(inside)}x${u32(inside)}`;
    if (box === "av1C") yield `${u32(inside) >> 8 & 252}`;
  }
}

/** Return a VideoFrame, which may tell Y, Cb and Cr, or an ImageBitmap. */
async function decodeImage(data) {
  if ("ImageDecoder" in self) return (await new ImageDecoder({ data, type }).decode()).image;
  return createImageBitmap(
    new Blob([data], { type }), { colorSpaceConversion: "none", premultiplyAlpha: "none" });
}
