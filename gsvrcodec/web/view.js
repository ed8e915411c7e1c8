/** How a picture lies on the screen. */

/** Pixels by which the edge of a part can be wrong: one of level 4 (section 8.5). */
const MARGIN = 16;

/**
 * How pixels of the frame go to the screen. `frame` is its size W, H before it is mirrored and
 * turned; `left` and `top` the place of the turned picture on the screen, pixels.
 */
export class View {
  constructor({ coded, frame, left = 0, top = 0, rotation = 0, mirrored = false, screen }) {
    this.frame = frame;
    this.left = left;
    this.top = top;
    this.screen = screen;
    const [width, height] = frame;
    this.zoom = [width / coded[0], height / coded[1]];
    // The pixel (x, y) of the frame is drawn at x columns[0] + y columns[1] + shift.
    const along = [[1, 0], [0, 1], [-1, 0], [0, -1]];
    const quarter = rotation / 90;
    const x = mirrored ? along[(quarter + 2) % 4] : along[quarter];
    const y = along[(quarter + 1) % 4];
    // What brings the least corner to 0, 0; in places between pixels.
    const corner = [0, 1].map(
      (axis) => -Math.min(0, x[axis] * width) - Math.min(0, y[axis] * height));
    this.columns = [...x, ...y];
    this.shift = [left + corner[0], top + corner[1]];
    this.region = this.visible();
  }

  /** Return the pixel, not rounded, at a place of the screen. */
  pixelAt([column, row]) {
    const [xx, xy, yx, yy] = this.columns;
    const dx = column - this.shift[0], dy = row - this.shift[1];
    return [xx * dx + xy * dy, yx * dx + yy * dy];
  }

  /** Return the part that is seen: x0, y0, x1, y1, of which x0 and y0 are on all levels. */
  visible() {
    const at = [[0, 0], this.screen].map((corner) => this.pixelAt(corner));
    const result = [0, 0, 0, 0];
    for (const axis of [0, 1]) {
      const least = Math.min(at[0][axis], at[1][axis]), most = Math.max(at[0][axis], at[1][axis]);
      const low = Math.floor(least / MARGIN) * MARGIN - MARGIN;
      result[axis] = Math.max(low, 0);
      result[axis + 2] = Math.min(Math.ceil(most / MARGIN) * MARGIN + MARGIN, this.frame[axis]);
    }
    return result;
  }

  get isEmpty() {
    const [x0, y0, x1, y1] = this.region;
    return x1 <= x0 || y1 <= y0;
  }
}
