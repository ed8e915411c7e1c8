/** How large pictures are rendered, by the time that they take. */

/** Milliseconds after the last touch until the picture gets full size. */
const REST = 250;
/** Least pixels of the longer side: a slow device shows fewer pictures instead. */
const LEAST_SIDE = 720;
/** Milliseconds that a picture may take before it gets smaller. */
const LONGEST = 80;

export class Pace {
  constructor(gl) {
    this.gl = gl;
    this.detail = 0.5; // rendered pixels for one of the screen, in each direction
    this.drawing = null;
    this.touched = 0;
    this.drawn = []; // times of the last second
  }

  /** Note that the picture will change again soon. */
  touch() {
    this.touched = performance.now();
  }

  /** Return whether the device still draws; else learn how long it took. */
  isBusy(budget) {
    if (!this.drawing) return false;
    const { sync, start, detail } = this.drawing;
    const { gl } = this;
    if (!gl.isContextLost() && gl.getSyncParameter(sync, gl.SYNC_STATUS) !== gl.SIGNALED) {
      return true;
    }
    gl.deleteSync(sync);
    this.drawing = null;
    const took = performance.now() - start;
    if (detail !== this.detail) return false;
    if (took > LONGEST) this.detail *= Math.max(0.5, Math.sqrt(LONGEST / took));
    else if (took < budget) this.detail *= 1.05;
    return false;
  }

  drew(detail) {
    const { gl } = this;
    const start = performance.now();
    this.drawing = { sync: gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0), start, detail };
    gl.flush();
    this.drawn.push(start);
  }

  get rate() {
    const now = performance.now();
    this.drawn = this.drawn.filter((time) => time > now - 1000);
    return this.drawn.length;
  }

  get isAtRest() {
    return performance.now() - this.touched > REST;
  }

  /** Return the detail of the next picture. */
  next(screen, isPlaying) {
    this.detail = Math.min(1, Math.max(this.detail, LEAST_SIDE / Math.max(...screen)));
    return !isPlaying && this.isAtRest ? 1 : this.detail;
  }
}
