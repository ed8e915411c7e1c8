/** Header chunk (section 4). */

import { Cursor } from "./bytes.js";
import { check, UnsupportedError } from "./errors.js";
import { limit } from "./limits.js";

const HEADER_BYTES = 71;
/** Bytes of the header in release candidates that were withdrawn. */
const CANDIDATES = [70, 72];
/** How pictures are formed, by number. */
const BLENDINGS = ["sum", "mean"];
const MIRRORED = 2 ** 15;

/** Parse the header, by step 3 of section 11. Unknown maxima are Infinity, unknown counts 0. */
export function parseHeader(payload) {
  const cursor = new Cursor(payload);
  const pair = () => [cursor.u32(), cursor.u32()];
  const maximum = (value, unknown) => (value === unknown ? Infinity : value);

  const version = [cursor.u16(), cursor.u16()];
  if (version[0] !== 1) {
    throw new UnsupportedError(`The film has version ${version.join(".")}, the player knows 1.0.`);
  }
  if (version[1] === 0 && CANDIDATES.includes(payload.length)) {
    throw new UnsupportedError(
      "The film is of an earlier release candidate of version 1.0: encode the video anew.");
  }
  const newer = version[1] > 0 && payload.length > HEADER_BYTES;
  check(newer || payload.length === HEADER_BYTES, `The header has ${payload.length} bytes.`);
  const required = cursor.u32(), flags = cursor.u32();
  if (required > 1) {
    throw new UnsupportedError(`The film needs unknown features, flags ${required}.`);
  }
  const [width, height] = pair(), sampleAspect = pair();
  const turn = cursor.u16(), rotation = turn % MIRRORED, bitDepth = cursor.u8();
  const [, , , fullRange, chromaLocation] = cursor.take(5);
  const timeBase = pair();
  const [mostGaussians, mostFrames] = pair().map((value) => maximum(value, 2 ** 32 - 1));
  const mostGrid = [0, 0, 0].map(() => maximum(cursor.u16(), 2 ** 16 - 1));
  const frames = Number(cursor.u64()), gops = cursor.u32();
  const blending = cursor.u8();
  if (blending >= BLENDINGS.length) {
    throw new UnsupportedError(`The film forms its pictures in an unknown way, ${blending}.`);
  }

  const positive = [width, height, ...sampleAspect, ...timeBase].every(Boolean);
  check(positive, "The header has a size, sample aspect ratio or time base of zero.");
  check([0, 90, 180, 270].includes(rotation), `The header has the rotation ${rotation}.`);
  check(bitDepth >= 1 && bitDepth <= 16, `The header has ${bitDepth} bits a sample.`);
  check(fullRange <= 1 && chromaLocation <= 6, "The header has unknown colours.");
  const plates = required === 1;
  check(!plates || BLENDINGS[blending] === "mean", "The header has plates in a film of sums.");
  limit("width", width, "The width");
  limit("height", height, "The height");
  limit("pixels", width * height, "The number of pixels");
  if (mostGaussians < Infinity) limit("gaussians", mostGaussians, "The number of Gaussians");
  if (mostFrames < Infinity) limit("gopFrames", mostFrames, "The number of frames in a GOP");
  return {
    version, width, height, sampleAspect, rotation, mirrored: turn >= MIRRORED, timeBase,
    mostGaussians, mostFrames, mostGrid, frames, gops, blending: BLENDINGS[blending], plates,
    imageCodecs: (flags & 1) > 0, stream: (flags & 2) > 0,
  };
}
