/** A film: what section 11 says about reading a file. */

import { DROPPED, SLOTS } from "./attributes.js";
import { readMetadata, readStream } from "./auxiliary.js";
import { Cursor } from "./bytes.js";
import {
  checkSignature, readChunkHead, readPayload, refuseUnknown, SIGNATURE_BYTES,
} from "./chunks.js";
import { check, CorruptError, GsvrError, isFault, located, orFault } from "./errors.js";
import { unpackGop } from "./gop.js";
import { readSummary } from "./gop_head.js";
import { parseHeader } from "./header.js";
import { readIndex } from "./index.js";
import { findMoving } from "./layers.js";
import { limit, limitExpansion } from "./limits.js";
import { carryOver, passageBetween } from "./prediction.js";
import { TakenOut } from "./taken_out.js";
import { walk } from "./walk.js";

const MOST_HEADER_BYTES = 4096;
/** Bytes of GOPs that are remembered, besides the last one. */
const MEMORY_BYTES = 2 ** 26;
/** As references: there is none, or it is not in the film. */
const KEY = -1, MISSING = -2;

export class Film {
  #known = new Map(); // GOPs, or their errors, by number; the longest unused one first
  #chunks = [];
  #others = [];
  #takenOut = null;

  constructor(source) {
    this.source = source;
    this.warnings = [];
  }

  /**
   * Open a film. After a CorruptError with `recoverable` it may be opened with `keepGoing`, which
   * takes the sound GOPs of a damaged file.
   */
  static async open(source, { keepGoing = false } = {}) {
    const film = new Film(source);
    const start = await film.#readHeader();
    const chunks = await film.#findChunks(start, keepGoing);
    film.#others = chunks.filter((chunk) => !chunk.summary);
    film.#chunks = chunks.filter((chunk) => chunk.summary);
    check(film.#chunks.length, ["The film has no GOP.", ...film.warnings].join(" "));
    film.#listGops();
    film.#compareCounts();
    return film;
  }

  /**
   * Decode GOP `k`. The result is shared and must not be changed: `pts`, ticks after the first one
   * of the GOP; `gaussians`, 14 floats each in the order of section 5.4, those carried over
   * included; `grids`, null, or `size` [Gx, Gy, Gt] and `xy`, `xt` and `yt`, rows x columns x 8
   * channels; `plate`, if any, the number of the GOP that stores it; `blending`; and for each
   * Gaussian whether it is `moving`, and whether it is `out` (null if none is).
   */
  async gop(k) {
    const gop = await this.#decoded(k), { pts, gaussians, grids, plate, blending } = gop;
    const out = this.#takenOut.mask(k, gop), moving = this.#moving(gaussians);
    return { pts, gaussians, moving, out, grids, plate: plate?.number, blending };
  }

  /** Return the plate of GOP `k`, as `decodePlate` does, with the `number` of its GOP. */
  async plate(k) {
    return (await this.#decoded(k)).plate;
  }

  /** Return the passage from GOP `k` to the next, which is predicted from it. */
  async passage(k) {
    const before = await this.#decoded(k), after = await this.#decoded(k + 1);
    const joined = (mask, next) =>
      Uint8Array.from([...next, ...mask.filter((_, n) => after.modes[n] === DROPPED)]);
    const masks = [[k, before], [k + 1, after]].map(([i, gop]) => this.#takenOut.mask(i, gop));
    return {
      ...passageBetween(before, after), out: masks[0] && joined(...masks),
      plate: after.plate?.number,
      moving: joined(this.#moving(before.gaussians), this.#moving(after.gaussians)),
    };
  }

  /**
   * Take out what moves at a place [x, y], -1 to 1, of GOP `k` at the time `tau`, for all GOPs.
   * Return how many Gaussians it has.
   */
  async takeOut(k, tau, place) {
    return this.#takenOut.add(k, await this.#decoded(k), tau, place);
  }

  async bringBack() {
    this.#takenOut.clear();
  }

  #moving(gaussians) {
    return findMoving(gaussians, this.header.width, this.header.height);
  }

  /** Return the sound copied streams: `{ bytes, type, disposition }` each. */
  async sounds() {
    const { streams = [] } = await this.metadata(), found = [];
    const chunks = this.#others.filter(({ type }) => type === "strm");
    for (const [i, chunk] of chunks.entries()) {
      const stream = await this.#soundOnly(readStream(this.source, chunk));
      if (stream) found.push({ disposition: 0, ...streams[i], ...stream });
    }
    return found;
  }

  /** Return the object of the chunk `meta`; empty without a sound one. */
  async metadata() {
    const chunk = this.#others.find(({ type }) => type === "meta");
    return (chunk && await this.#soundOnly(readMetadata(this.source, chunk))) ?? {};
  }

  /** Steps 1 to 3 of section 11; return where the header ends. */
  async #readHeader() {
    await checkSignature(this.source);
    const chunk = await readChunkHead(this.source, SIGNATURE_BYTES);
    check(chunk.type === "HEAD", "The first chunk of the file is not the header.");
    const fits = chunk.length >= 4 && chunk.length <= MOST_HEADER_BYTES;
    check(fits, `The header has ${chunk.length} bytes.`);
    this.header = parseHeader(await readPayload(this.source, chunk));
    this.#takenOut = new TakenOut(this.header);
    return chunk.end;
  }

  /** Steps 4 and 5 of section 11: return the chunks after the header. */
  async #findChunks(start, keepGoing) {
    const listed = await orFault(readIndex(this.source, start));
    if (!(listed instanceof CorruptError)) {
      listed.forEach(refuseUnknown);
      return listed;
    }
    const { chunks, faults, ended } = await walk(this.source, start, this.header);
    if (this.header.stream && !ended && !faults.length) return chunks;
    this.warnings = [located(listed, "The film is damaged or not finished").message, ...faults];
    if (!keepGoing && chunks.some(({ summary }) => summary)) {
      throw Object.assign(new CorruptError(this.warnings[0]), { recoverable: true });
    }
    return chunks;
  }

  /** Describe the GOPs; check the length of chains. */
  #listGops() {
    const { firstPts: origin } = this.#chunks[0].summary, places = new Map();
    let number = 0;
    this.origin = Number(origin); // from which `gops` count their ticks
    this.gops = this.#chunks.map((chunk, k) => {
      const { firstFrame, frames, gaussians, distance, ...times } = chunk.summary;
      const reference = distance ? places.get(firstFrame - BigInt(distance)) ?? MISSING : KEY;
      const { depth = 0, chainBytes = 0 } = this.#chunks[reference] ?? {};
      Object.assign(chunk, { depth: depth + 1, chainBytes: chainBytes + chunk.length, number });
      number += gaussians;
      limit("chain", chunk.depth, "The number of GOPs in a chain of references");
      places.set(firstFrame, k);
      return {
        firstFrame: Number(firstFrame), frames, gaussians, reference, bytes: chunk.length,
        start: Number(times.firstPts - origin), end: Number(times.lastPts - origin),
        lastDuration: Number(times.lastDuration),
      };
    });
  }

  /** Warn of harmless faults. */
  #compareCounts() {
    const { firstFrame, frames } = this.gops.at(-1);
    const found = { frames: firstFrame + frames, gops: this.gops.length };
    for (const [what, count] of Object.entries(found)) {
      const said = this.header[what];
      if (said && said !== count) {
        this.warnings.push(`The film has ${count} ${what}, its header says ${said}.`);
      }
    }
    for (const type of ["sett", "meta"]) {
      const several = this.#others.filter((chunk) => chunk.type === type).length > 1;
      if (several) this.warnings.push(`The film has several chunks ${type}.`);
    }
  }

  /** Return what the reader of an auxiliary chunk gives; if it fails, warn, and return null. */
  async #soundOnly(promise) {
    try {
      return await promise;
    } catch (error) {
      if (!isFault(error)) throw error;
      if (!this.warnings.includes(error.message)) this.warnings.push(error.message);
      return null;
    }
  }

  /** Return a GOP with what it takes over. */
  async #decoded(k) {
    if (!this.gops[k]) throw new GsvrError(`The film has no GOP ${k}.`);
    const chain = [];
    let link = k;
    for (; link >= 0 && !this.#known.has(link); link = this.gops[link].reference) chain.push(link);
    let gop = link >= 0 ? this.#recall(link) : null;
    for (const next of chain.reverse()) {
      try {
        check(gop || this.gops[next].reference !== MISSING, `${this.#place(next)}: its reference `
          + "is not in the film.");
        gop = await this.#unpack(next, gop);
        this.#remember(next, gop);
      } catch (error) {
        if (isFault(error)) this.#remember(next, error);
        throw error;
      }
    }
    return gop;
  }

  /** Decode a GOP, whose `reference` is decoded already, or null. */
  async #unpack(k, reference) {
    const chunk = this.#chunks[k], { summary, chainBytes, number } = chunk;
    const payload = await readPayload(this.source, chunk);
    try {
      const found = readSummary(new Cursor(payload));
      const same = Object.keys(found).every((key) => found[key] === summary[key]);
      check(same, "it is not the GOP that the index names.");
      limitExpansion(SLOTS * summary.gaussians, chainBytes);
      const own = await unpackGop(payload, this.header);
      const gop = reference ? carryOver(own, reference) : own;
      const fresh = own.gaussians.length / SLOTS;
      const plate = own.plate ? { ...own.plate, number: k } : reference?.plate;
      return { ...gop, fresh, plate, numbers: numbersOf(gop, reference, number) };
    } catch (error) {
      throw located(error, this.#place(k));
    }
  }

  #place(k) {
    return `The GOP at byte ${this.#chunks[k].offset}`;
  }

  #recall(k) {
    const found = this.#known.get(k);
    this.#remember(k, found);
    if (found instanceof GsvrError) throw found;
    return found;
  }

  #remember(k, gop) {
    this.#known.delete(k);
    for (const unused of this.#known.keys()) {
      if (sizeOf(this.#known.values()) <= MEMORY_BYTES) break;
      this.#known.delete(unused);
    }
    this.#known.set(k, gop);
  }
}

/** Number Gaussians alike in all GOPs, new ones from `first` on. */
function numbersOf({ gaussians, modes }, reference, first) {
  const kept = reference ? reference.numbers.filter((_, n) => modes[n] !== DROPPED) : [];
  return Float64Array.from({ length: gaussians.length / SLOTS }, (_, n) => kept[n] ?? first + n);
}

/** Return the bytes of GOPs, which may share plates; errors have none. */
function sizeOf(gops) {
  const arrays = new Set([...gops].flatMap(({ gaussians, modes, numbers, grids, plate }) =>
    [gaussians, modes, numbers, plate?.texels, ...Object.values(grids ?? {})]));
  return [...arrays].reduce((sum, array) => sum + (array?.byteLength ?? 0), 0);
}
