/** Where the bytes of a film come from: a file of the user, or a server. */

import { GsvrError } from "./errors.js";

/** Least bytes that are read at a time, and of both ends of a film at once. */
const PIECE_BYTES = 2 ** 16;

/** Open a Blob or an absolute URL. Return its `size` in bytes, and `read(offset, length)`. */
export async function openSource(from) {
  const { size, fetchBytes, pieces = [] } = typeof from === "string"
    ? await openUrl(from) : openBlob(from);
  const load = async (offset, length) => {
    const bytes = await fetchBytes(offset, length);
    if (bytes.length !== length) throw new GsvrError("The film changed while it was read.");
    return { offset, bytes };
  };
  let recent = { offset: 0, bytes: new Uint8Array(0) };
  const read = async (offset, length) => {
    if (offset + length > size) throw new GsvrError("The film is too short.");
    const holds = (piece) => piece.offset <= offset
      && offset + length <= piece.offset + piece.bytes.length;
    let piece = [...pieces, recent].find(holds);
    if (!piece) {
      piece = await load(offset, Math.min(Math.max(length, PIECE_BYTES), size - offset));
      recent = piece;
    }
    return piece.bytes.subarray(offset - piece.offset, offset - piece.offset + length);
  };
  if (!pieces.length) pieces.push(await load(0, Math.min(PIECE_BYTES, size)));
  if (size > PIECE_BYTES) pieces.push(await load(size - PIECE_BYTES, PIECE_BYTES));
  return { size, read };
}

function openBlob(blob) {
  const fetchBytes = (offset, length) => bytesOf(blob.slice(offset, offset + length));
  return { size: blob.size, fetchBytes };
}

/** Ask the server for the start of the film; it may send all. */
async function openUrl(url) {
  const response = await request(url, 0, PIECE_BYTES);
  const total = response.headers.get("Content-Range")?.match(/\/(\d+)$/);
  if (response.status === 200) return openBlob(new Blob([await bytesOf(response)]));
  if (!total) return openBlob(new Blob([await bytesOf(await request(url))]));
  const fetchBytes = async (offset, length) => bytesOf(await request(url, offset, length));
  const bytes = response.ok ? await bytesOf(response) : new Uint8Array(0);
  return { size: Number(total[1]), fetchBytes, pieces: [{ offset: 0, bytes }] };
}

/** Ask a server for some bytes of a file, or for all. */
async function request(url, offset = 0, length = 0) {
  const headers = length ? { Range: `bytes=${offset}-${offset + length - 1}` } : {};
  const response = await fetch(url, { headers }).catch(() => {
    throw new GsvrError("The server of the film cannot be reached.");
  });
  // 416 for the start of a file says that the file is empty.
  const expected = response.ok || (response.status === 416 && offset === 0);
  if (!expected) throw new GsvrError(`The server of the film answers ${response.status}.`);
  return response;
}

async function bytesOf(body) {
  try {
    return new Uint8Array(await body.arrayBuffer());
  } catch {
    throw new GsvrError("The film cannot be read to its end.");
  }
}
