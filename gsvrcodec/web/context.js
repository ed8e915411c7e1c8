/** Codec 4, context (section 6): samples are predicted from neighbours and prior planes. */

import { unzigzag } from "./bytes.js";
import { check } from "./errors.js";
import { RangeCoder } from "./range_coder.js";

const TOKENS = 256, SLOT_BITS = 12, CONTEXT_SLOTS = 1 << SLOT_BITS;
const MOST_LEVEL = 49;
/** Instead of a count of bits: the token must not occur. */
const NO_TOKEN = 255;

/** Decode a plane into `samples`, a Uint16Array in raster order. */
export function decodeContext(cursor, plane, samples) {
  const head = readContextHead(cursor, plane);
  const coder = new RangeCoder(cursor);
  const slots = new Int32Array((head.thresholds.length + 1) * CONTEXT_SLOTS);
  for (let start = 0; start < slots.length; start += CONTEXT_SLOTS) {
    fillSlots(slots, start, readFrequencies(coder));
  }
  coder.checkSpace(coder.at);
  decodeErrors(coder, plane, head, slots, samples);
}

function readContextHead(cursor, { grid }) {
  const flags = cursor.u8(), prior = grid.planes, guided = (flags & 16) > 0, terms = [];
  check(flags < 64, "it has unknown flags.");
  check(!guided || (grid.guided && prior.length), "it has no plane to be guided by.");
  let magnitude = 0;
  for (let i = 0, least = 0; i < (flags & 15); i++) {
    const number = cursor.u8(), weight = unzigzag(cursor.varint32());
    check(number >= least && number < prior.length, "it refers to a plane that is not before it.");
    magnitude += Math.abs(weight);
    check(weight && magnitude <= 2 ** 12, "the weight of a prior plane is out of bounds.");
    terms.push({ prior: prior[number].samples, weight });
    least = number + 1;
  }
  const bias = unzigzag(cursor.varint32());
  check(Math.abs(bias) < 2 ** 29, "its bias is out of bounds.");
  const weights = [0, 0, 0, 0, 0, 0].map(() => (flags & 32 ? cursor.i8() : 0));
  const division = cursor.u8(), direct = division & 15, top = division >> 4;
  check(top <= 2 && top < direct && direct <= 7, "its tokens are divided in an unknown way.");
  const count = cursor.u8(), thresholds = [];
  check(count <= 7, "it has too many contexts.");
  for (let i = 0, threshold = 0; i < count; i++) {
    const step = cursor.varint32();
    threshold += step;
    check(step && threshold <= 2 ** 20, "a threshold is out of bounds.");
    thresholds.push(threshold);
  }
  return { columns: guided ? guide(grid) : null, terms, bias, weights, direct, top, thresholds };
}

/** Return the column m of the neighbour above each sample, by position.x. */
function guide(grid) {
  const { width, height, planes: [{ samples }] } = grid;
  if (grid.columns) return grid.columns;
  grid.columns = new Uint16Array(width * height);
  for (let row = width; row < width * height; row += width) {
    for (let x = 0, m = 0; x < width; x++) {
      while (m + 1 < width && samples[row - width + m + 1] <= samples[row + x]) m++;
      grid.columns[row + x] = m;
    }
  }
  return grid.columns;
}

/** Read the frequencies of the tokens of a context, which fill its slots. */
function readFrequencies(coder) {
  const level = new Int32Array(TOKENS), sum = (total, n) => total + n;
  const count = coder.bits(8) + 1;
  for (let t = 0; t < count; t++) {
    let high = 0;
    while (high <= MOST_LEVEL && coder.bits(1)) high++;
    level[t] = (t >= 2 ? level[t - 2] : 0) + unzigzag(2 * high + coder.bits(1));
    check(level[t] >= 0 && level[t] <= MOST_LEVEL, "the level of a token is out of bounds.");
  }
  const used = level.filter((n) => n > 0).length;
  check(used, "a context has no token.");
  const weight = level.map((n) => (n >= 2 ? 4 + (n - 2) % 4 << (n - 2 >> 2) : 0));
  const total = Math.max(weight.reduce(sum), 1), free = CONTEXT_SLOTS - used;
  const frequency = level.map((n, t) => (n ? 1 + Math.floor(weight[t] * free / total) : 0));
  const rest = CONTEXT_SLOTS - frequency.reduce(sum);
  frequency[level.indexOf(Math.max(...level))] += rest;
  return frequency;
}

/** Write into each slot its token, its number there, and the token's frequency minus 1. */
function fillSlots(slots, start, frequency) {
  for (let t = 0, at = start; t < TOKENS; t++) {
    for (let i = 0; i < frequency[t]; i++) slots[at++] = t << 24 | i << 12 | frequency[t] - 1;
  }
}

/** Return by token the count of its plain bits, and its number if these are 0. */
function divideTokens({ direct, top }) {
  const plain = new Uint8Array(TOKENS), base = new Int32Array(TOKENS);
  for (let t = 0; t < TOKENS; t++) {
    const over = t - (1 << direct), part = over & (2 << top) - 1;
    const bits = (over >> top + 1) + direct - top - 1;
    if (over >= 0) plain[t] = bits > 16 ? NO_TOKEN : bits;
    base[t] = over < 0 ? t : (1 << top) + (part >> 1) << bits + 1 | part & 1;
  }
  return { plain, base };
}

/** Return contexts by `around`. */
function contextTable(thresholds) {
  const table = new Uint8Array((thresholds.at(-1) ?? 0) + 1);
  thresholds.forEach((threshold, i) => table.fill(i + 1, threshold));
  return table;
}

/**
 * Decode the samples. d and |e| of section 6 are kept for two rows, which have a cell more on the
 * left and two on the right, copies of the outermost: no neighbour is missing.
 */
function decodeErrors(coder, { bits, grid: { width, height } }, head, slots, samples) {
  const { columns, terms, bias } = head, [v0, v1, v2, v3, v4, v5] = head.weights;
  const most = 2 ** bits - 1, { plain, base } = divideTokens(head);
  const contexts = contextTable(head.thresholds), lastContext = contexts.length - 1;
  const { bytes } = coder, c = new Int32Array(width);
  let { state, at } = coder;
  let [d, e, dAbove, eAbove] = [0, 0, 0, 0].map(() => new Int32Array(width + 3));

  for (let y = 0, row = 0; y < height; y++, row += width) {
    c.fill(bias);
    for (const { prior, weight } of terms) {
      for (let x = 0; x < width; x++) c[x] += Math.imul(weight, prior[row + x]);
    }
    // The cells at m, m + 1, m - 1 and m + 2 above; in the first row four times the left one.
    const dUp = y ? dAbove : d, eUp = y ? eAbove : e;
    const i0 = y ? 1 : 0, i1 = y ? 2 : 0, i2 = 0, i3 = y ? 3 : 0;
    let dLeft = y ? dAbove[1] : 0, dLeft2 = dLeft, eLeft = y ? eAbove[1] : 0, eLeft2 = eLeft;
    for (let x = 0; x < width; x++) {
      const m = columns !== null && y ? columns[row + x] : x;
      // (c + (sum >> 6) + 128) >> 8 in exact binary64: what is rounded up from below 0 is clamped.
      const pull = v0 * dLeft + v1 * dLeft2 + v2 * dUp[m + i0] + v3 * dUp[m + i1]
        + v4 * dUp[m + i2] + v5 * dUp[m + i3];
      const wanted = (64 * (c[x] + 128) + pull) / 16384 | 0;
      const p = wanted < 0 ? 0 : wanted > most ? most : wanted;
      const around = 2 * (eLeft + eUp[m + i0] + eUp[m + i1]) + eLeft2 + eUp[m + i2] + eUp[m + i3];
      const context = contexts[around < lastContext ? around : lastContext];

      const slot = slots[context << SLOT_BITS | state & CONTEXT_SLOTS - 1], token = slot >>> 24;
      state = Math.imul((slot & 4095) + 1, state >>> SLOT_BITS) + (slot >>> 12 & 4095) | 0;
      if (state >>> 16 === 0) {
        state = state << 16 | bytes[at] | bytes[at + 1] << 8;
        at += 2;
      }
      let number = base[token];
      if (plain[token] > 0) {
        check(plain[token] !== NO_TOKEN, "a token stands for too large a number.");
        number |= coder.bits(plain[token]) << 1;
      }
      const error = unzigzag(number), sample = p + error;
      check(sample >= 0 && sample <= most, "a sample is out of bounds.");
      samples[row + x] = sample;
      d[x + 1] = 256 * sample - c[x];
      e[x + 1] = Math.abs(error);
      dLeft2 = x ? dLeft : d[1];
      eLeft2 = x ? eLeft : e[1];
      dLeft = d[x + 1];
      eLeft = e[x + 1];
    }
    coder.checkSpace(at);
    for (const cells of [d, e]) {
      cells[0] = cells[1];
      cells[width + 1] = cells[width + 2] = cells[width];
    }
    [d, dAbove, e, eAbove] = [dAbove, d, eAbove, e];
  }
  coder.finish(state, at);
}
