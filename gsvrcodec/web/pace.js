/** How large pictures are rendered, by the time that the device takes for them. */

/** Milliseconds after the last touch until a picture is rendered at full size. */
const REST = 250;
/** Least pixels of the longer side of the screen: a slow device shows fewer pictures instead. */
const LEAST_SIDE = 720;
/** Milliseconds that a picture may take before it gets smaller. */
const LONGEST = 80;

export class Pace {
  constructor(gl) {
    this.gl = gl;
    this.detail = 0.5; // rendered pixels for one pixel of the screen, in each direction
    this.drawing = null;
    this.touched = 0;
    this.drawn = []; // when the pictures of the last second were drawn
  }

  /** Note that the picture will change again soon. */
  touch() {
    this.touched = performance.now();
  }

  /** Return whether the device still draws; else learn from how long it took. */
  isBusy(budget) {
    if (!this.drawing) return false;
    const { sync, start, detail } = this.drawing;
    const { gl } = this;
    if (!gl.isContextLost() && gl.getSyncParameter(sync, gl.SYNC_STATUS) !== gl.SIGNALED) {
      return true;
    }
    gl.deleteSync(sync);
    this.drawing = null;
    if (detail === this.detail) this.learn(performance.now() - start, budget);
    return false;
  }

  learn(took, budget) {
    if (took > LONGEST) this.detail *= Math.max(0.5, Math.sqrt(LONGEST / took));
    else if (took < budget) this.detail *= 1.05;
  }

  /** Note that a picture was drawn. */
  drew(detail) {
    const { gl } = this;
    const start = performance.now();
    this.drawing = { sync: gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0), start, detail };
    gl.flush();
    this.drawn.push(start);
  }

  /** Return the pictures drawn in the last second. */
  get rate() {
    const now = performance.now();
    this.drawn = this.drawn.filter((time) => time > now - 1000);
    return this.drawn.length;
  }

  /** Return whether a picture at rest is to be rendered at full size now. */
  get isAtRest() {
    return performance.now() - this.touched > REST;
  }

  /** Return the detail of the next picture for a screen of pixels. */
  next(screen, isPlaying) {
    this.detail = Math.min(1, Math.max(this.detail, LEAST_SIDE / Math.max(...screen)));
    return !isPlaying && this.isAtRest ? 1 : this.detail;
  }
}
