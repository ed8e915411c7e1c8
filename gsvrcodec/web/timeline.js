/** Where a film is at a time (section 8.1): ticks after its first timestamp. */

export class Timeline {
  /** Of a film; a missing last duration is that of a mean frame. */
  constructor(header, gops) {
    const [numerator, denominator] = header.timeBase;
    this.tick = numerator / denominator;
    this.gops = gops;
    const last = gops.at(-1);
    const frames = gops.reduce((sum, gop) => sum + gop.frames, 0);
    const spoken = last.lastDuration || (frames > 1 ? last.end / (frames - 1) : 1 / this.tick);
    this.end = last.end + spoken;
    this.frame = this.end / frames; // mean length
  }

  /** Return the number of the GOP that is shown at a time. */
  gopAt(time) {
    let low = 0, high = this.gops.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.gops[middle].start <= time) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  /**
   * Return the moment of a time in the GOP that is shown: `{ index, frame, tau, next }`. `between`
   * frames, `next` is the weight of the next GOP; it is 0 within this one.
   */
  moment(time, index, pts, between) {
    const after = time - this.gops[index].start;
    const last = pts.length - 1;
    let frame = last;
    while (frame > 0 && pts[frame] > after) frame--;
    const following = this.gops[index + 1];
    if (between && after > pts[last] && following) {
      const next = (after - pts[last]) / (following.start - this.gops[index].end);
      return { index, frame, tau: tauOf(pts[last], pts), next: Math.min(next, 1) };
    }
    const at = between ? Math.min(Math.max(after, 0), pts[last]) : pts[frame];
    return { index, frame, tau: tauOf(at, pts), next: 0 };
  }

  /** Return the time of the frame before (-1) or after (1) that at `time`; null at the ends. */
  neighbour(time, index, pts, direction) {
    const { start } = this.gops[index];
    const { frame } = this.moment(time, index, pts, false);
    if (direction < 0 && start + pts[frame] < time) return start + pts[frame];
    const wanted = frame + direction;
    if (wanted < 0) return index > 0 ? this.gops[index - 1].end : null;
    if (wanted < pts.length) return start + pts[wanted];
    return index + 1 < this.gops.length ? this.gops[index + 1].start : null;
  }

  bitRate(index) {
    const { bytes, start } = this.gops[index];
    const end = index + 1 < this.gops.length ? this.gops[index + 1].start : this.end;
    return (8 * bytes) / ((end - start) * this.tick);
  }
}

/** tau of section 8.1, `a` ticks after the first of the frames. */
export function tauOf(a, pts) {
  const b = pts[pts.length - 1];
  return pts.length > 1 ? Math.fround((2 * a - b) / b) : 0;
}

/** Return seconds as a person writes them: 1:02:03.45. */
export function clockText(seconds) {
  const hundredths = Math.floor(seconds * 100 + 1e-6);
  const minutes = Math.floor(hundredths / 6000);
  const tail = ((hundredths % 6000) / 100).toFixed(2).padStart(5, "0");
  if (minutes < 60) return `${minutes}:${tail}`;
  return `${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, "0")}:${tail}`;
}
