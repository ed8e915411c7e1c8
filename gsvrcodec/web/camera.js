/** Which part of the picture is seen, and how large. */

import { View } from "./view.js";

const MOST_ZOOM = 64;
/** Longest side of a picture, pixels. */
const MOST_SIDE = 32768;

export class Camera {
  constructor(header) {
    this.header = header;
    const [width, height] = header.sampleAspect;
    this.size = [(header.width * width) / height, header.height];
    this.turned = header.rotation % 180 ? [...this.size].reverse() : this.size;
    this.reset();
  }

  /** Show all of the picture. */
  reset() {
    this.zoom = 1;
    this.centre = [0.5, 0.5]; // of the turned picture, that is in the middle of the screen
  }

  /** Return pixels of the screen for a pixel of the film. */
  scale(screen) {
    const fit = Math.min(screen[0] / this.turned[0], screen[1] / this.turned[1]);
    return Math.min(fit * this.zoom, MOST_SIDE / Math.max(...this.size));
  }

  /** Zoom about a place of the screen, in its unit. */
  zoomAt(place, factor, screen) {
    const zoom = Math.min(Math.max(this.zoom * factor, 1), MOST_ZOOM);
    const before = this.scale(screen);
    this.zoom = zoom;
    const after = this.scale(screen);
    const way = [0, 1].map((axis) => (place[axis] - screen[axis] / 2) * (1 - after / before));
    this.moveBy(way, screen);
  }

  /** Move the picture by a distance on the screen. */
  moveBy(distance, screen) {
    const scale = this.scale(screen);
    this.centre = this.centre.map((at, axis) => {
      const side = this.turned[axis] * scale;
      const half = Math.min(screen[axis] / side / 2, 0.5); // the picture fills what it can
      return Math.min(Math.max(at - distance[axis] / side, half), 1 - half);
    });
  }

  view(screen) {
    const scale = this.scale(screen);
    const frame = this.size.map((side) => Math.max(1, Math.round(side * scale)));
    const turned = this.header.rotation % 180 ? [...frame].reverse() : frame;
    const [left, top] = [0, 1].map(
      (axis) => Math.round(screen[axis] / 2 - this.centre[axis] * turned[axis]));
    const { width, height, rotation, mirrored } = this.header;
    return new View({ coded: [width, height], frame, left, top, rotation, mirrored, screen });
  }
}
