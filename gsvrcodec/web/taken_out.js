/** What is taken out of a film: Gaussians that touch each other and move alike. */

import { LINEAR, LOG_OPACITY, LOOK_SLOTS, QUADRATIC, SLOTS } from "./attributes.js";
import { findMoving, LEAST_WAY } from "./layers.js";
import { look } from "./prediction.js";

/** Sigmas at which a tap hits a Gaussian, and least weight beside the largest. */
const HIT = 3, LEAST_WEIGHT = 0.1;
/** Gap across which Gaussians touch, and a tap may miss them, in longer sides. */
const GAP = 1 / 200;
/** Longest distance at which large Gaussians touch, in longer sides. */
const CELL = 1 / 32;
/** Ways that are alike differ by a share of the least way that moves, and of their own. */
const ALIKE = [0.5, 0.3];

export class TakenOut {
  #numbers = new Set(); // of the Gaussians that are out
  #ends = new Map(); // by GOP: their bodies in its first and its last frame
  #tapped = new Set(); // GOPs with taps

  constructor({ width, height }) {
    this.width = width;
    this.height = height;
    this.side = Math.max(width, height);
  }

  /** Bring all back. */
  clear() {
    for (const known of [this.#numbers, this.#ends, this.#tapped]) known.clear();
  }

  /** Take out what moves at a place [x, y], -1 to 1, of GOP `k`, as `Film.takeOut`. */
  add(k, gop, tau, place) {
    const looks = look(gop, tau), moving = this.#moving(gop), blur = (GAP * this.side) ** 2;
    const weights = moving.map((n) => {
      const [x, y, log0, log1, theta] = looks.subarray(n * LOOK_SLOTS);
      const dx = (place[0] - x) * this.width / 2, dy = (place[1] - y) * this.height / 2;
      const along = Math.cos(theta) * dx + Math.sin(theta) * dy;
      const across = Math.cos(theta) * dy - Math.sin(theta) * dx;
      const square = along ** 2 / (Math.exp(2 * log0) + blur)
        + across ** 2 / (Math.exp(2 * log1) + blur);
      return square < HIT ** 2 ? Math.exp(looks[n * LOOK_SLOTS + LOG_OPACITY] - square / 2) : 0;
    });
    const least = LEAST_WEIGHT * weights.reduce((a, b) => Math.max(a, b), Number.MIN_VALUE);
    const hit = moving.filter((_, i) => weights[i] > least);
    const thing = this.#grow(gop, this.#bodies(gop, tau, hit), this.#bodies(gop, tau, moving));
    for (const { n } of thing) this.#numbers.add(gop.numbers[n]);
    this.#tapped.add(k);
    return thing.length;
  }

  /**
   * Return 1 for each Gaussian of GOP `k` that is out, else 0; null if none in the film is. To
   * those carried over come new ones that touch them and move alike. Where none was carried over,
   * the thing is where it was at the end of the GOP before, or at the start of the one behind, if
   * that was asked for.
   */
  mask(k, gop) {
    if (this.#numbers.size === 0) return null;
    const isOut = Uint8Array.from(gop.numbers, (number) => Number(this.#numbers.has(number)));
    const fresh = this.#moving(gop).filter((n) => n >= isOut.length - gop.fresh && !isOut[n]);
    const add = (tau, seeds) => {
      for (const { n } of this.#grow(gop, seeds, this.#bodies(gop, tau, fresh))) {
        isOut[n] = 1;
        this.#numbers.add(gop.numbers[n]);
      }
    };
    if (!isOut.includes(1)) {
      add(-1, this.#ends.get(k - 1)?.[1] ?? []);
      add(1, this.#ends.get(k + 1)?.[0] ?? []);
    } else if (!this.#tapped.has(k)) {
      add(0, this.#bodies(gop, 0, ones(isOut)));
    }
    this.#ends.set(k, [-1, 1].map((tau) => this.#bodies(gop, tau, ones(isOut))));
    return isOut;
  }

  #moving({ gaussians }) {
    return ones(findMoving(gaussians, this.width, this.height));
  }

  /** Return of Gaussians number, place and radius, pixels, and way of a tick. */
  #bodies(gop, tau, chosen) {
    const { gaussians: g, pts } = gop, looks = look(gop, tau);
    const perTick = pts.length > 1 ? 2 / pts.at(-1) : 0;
    const [right, down] = [this.width / 2, this.height / 2];
    return chosen.map((n) => {
      const [x, y, log0, log1] = looks.subarray(n * LOOK_SLOTS);
      const [u, v] = [0, 1].map((axis) => perTick * (g[n * SLOTS + LINEAR + axis]
        + 2 * tau * g[n * SLOTS + QUADRATIC + axis]));
      const r = Math.exp((log0 + log1) / 2);
      return { n, x: x * right, y: y * down, r, u: u * right, v: v * down };
    });
  }

  /** Return the `others` that touch and move alike with one of `seeds`, or of those found. */
  #grow({ pts }, seeds, others) {
    const cell = CELL * this.side, gap = GAP * this.side, [few, share] = ALIKE;
    const least = few * LEAST_WAY * this.side * 2 / pts.at(-1);
    const keyOf = (x, y) => `${Math.floor(x / cell)} ${Math.floor(y / cell)}`;
    const cells = new Map(), queue = [...seeds], found = [];
    for (const b of others) {
      const key = keyOf(b.x, b.y);
      if (!cells.has(key)) cells.set(key, []);
      cells.get(key).push(b);
    }
    while (queue.length) {
      const a = queue.pop(), allowed = least + share * Math.hypot(a.u, a.v);
      for (let i = 0; i < 9; i++) {
        const key = keyOf(a.x + (i % 3 - 1) * cell, a.y + (Math.floor(i / 3) - 1) * cell);
        const isJoined = (b) => Math.hypot(a.u - b.u, a.v - b.v) < allowed
          && Math.hypot(a.x - b.x, a.y - b.y) < Math.min(a.r + b.r + gap, cell);
        const near = cells.get(key) ?? [], joined = near.filter(isJoined);
        if (joined.length) cells.set(key, near.filter((b) => !isJoined(b)));
        queue.push(...joined);
        found.push(...joined);
      }
    }
    return found;
  }
}

function ones(mask) {
  return [...mask.keys()].filter((n) => mask[n] === 1);
}
