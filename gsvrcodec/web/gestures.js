/** Taps, drags, pinches and the wheel, of fingers and mice. */

/** Pixels that a tap may move. */
const TAP = 6;

export class Gestures {
  /** `actions`: `tap([x, y])`, `drag([dx, dy])`, `zoom([x, y], factor)`, pixels of the element. */
  constructor(element, actions) {
    this.element = element;
    this.actions = actions;
    this.pointers = new Map();
    this.moved = 0;
    element.addEventListener("pointerdown", (event) => this.down(event));
    element.addEventListener("pointermove", (event) => this.move(event));
    element.addEventListener("pointerup", (event) => this.up(event));
    element.addEventListener("pointercancel", (event) => this.pointers.delete(event.pointerId));
    element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
  }

  place(event) {
    const { left, top } = this.element.getBoundingClientRect();
    return [event.clientX - left, event.clientY - top];
  }

  down(event) {
    if (this.pointers.size === 0) this.moved = 0;
    this.pointers.set(event.pointerId, this.place(event));
    this.element.setPointerCapture(event.pointerId);
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const after = this.place(event);
    const distance = [after[0] - before[0], after[1] - before[1]];
    this.moved += Math.hypot(...distance);
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId);
    this.pointers.set(event.pointerId, after);
    if (others.length === 0) {
      if (this.moved > TAP) this.actions.drag(distance);
      return;
    }
    // Of two fingers, the middle moves the picture, the distance zooms it.
    const other = others[0][1];
    const length = (place) => Math.max(1, Math.hypot(place[0] - other[0], place[1] - other[1]));
    const middle = [(after[0] + other[0]) / 2, (after[1] + other[1]) / 2];
    this.actions.drag(distance.map((each) => each / 2));
    this.actions.zoom(middle, length(after) / length(before));
  }

  up(event) {
    const wasDown = this.pointers.delete(event.pointerId);
    if (wasDown && this.pointers.size === 0 && this.moved <= TAP && event.button === 0) {
      this.actions.tap(this.place(event));
    }
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 0 ? event.deltaY / 100 : event.deltaY / 3;
    this.actions.zoom(this.place(event), 1.25 ** -lines);
  }
}
