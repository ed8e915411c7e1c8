/** Metadata and copied streams (section 10); the caller leaves out faulty ones. */

import { readPayload } from "./chunks.js";
import { check } from "./errors.js";
import { limit } from "./limits.js";

/** Return the object in the chunk `meta`. */
export async function readMetadata(source, chunk) {
  limit("metadataBytes", chunk.length, "The length of the metadata");
  const payload = await readPayload(source, chunk);
  let value = null;
  try {
    value = JSON.parse(new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(payload));
  } catch {
    // It stays null.
  }
  check(isMetadata(value), "The metadata do not keep to their format.");
  return value;
}

/** Return the `bytes` of a chunk `strm`, and the media `type` of its container. */
export async function readStream(source, chunk) {
  const bytes = await readPayload(source, chunk);
  const start = String.fromCharCode(...bytes.subarray(0, 25));
  let type = "";
  if (start.slice(4, 12) === "ftypqt  ") type = "video/quicktime";
  else if (start.slice(4, 8) === "ftyp") type = "video/mp4";
  else if (start.startsWith("\x1aE\xdf\xa3")) type = "video/x-matroska";
  else if (start === "nut/multimedia container\0") type = "video/x-nut";
  check(type, `The stream at byte ${chunk.offset} is in an unknown container.`);
  return { bytes, type };
}

function isMetadata(value) {
  if (!isObject(value)) return false;
  const { film = {}, video = {}, streams = [], chapters = [] } = value;
  return isTags(film) && isStream(video) && Array.isArray(streams) && streams.every(isStream)
    && Array.isArray(chapters) && chapters.every(isChapter);
}

function isObject(value) {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

function isTags(value) {
  return isObject(value) && Object.values(value).every((text) => typeof text === "string");
}

function isStream(value) {
  const { tags = {}, disposition = 0 } = value ?? {};
  return isObject(value) && isTags(tags) && Number.isInteger(disposition);
}

function isChapter(value) {
  const isTime = (pair) => Array.isArray(pair) && pair.length === 2 && pair.every(Number.isInteger)
    && pair[1] !== 0;
  return isObject(value) && isTime(value.start) && isTime(value.stop) && isTags(value.tags);
}
