// An orthographic camera: panned and zoomed over a plane, turned around a point in space. Mouse, touch, wheel, keys.

const KEY_STEP = 0.12;
const KEY_TURN = Math.PI / 24;
const WHEEL = 0.0016;
const CLICK_PIXELS = 4;

export class Camera {
  /** changed() is called when the view changes; clicked(x, y) in pixels. */
  constructor(canvas, changed, clicked) {
    this.canvas = canvas;
    this.changed = changed;
    this.clicked = clicked;
    this.flat = true;
    this.fit();
    this.pointers = new Map();
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.up(event));
    canvas.addEventListener("pointercancel", (event) => this.pointers.delete(event.pointerId));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
  }

  /** Show everything: the mesh lies in −1 … 1. */
  fit(reach = [1, 1]) {
    this.reach = reach;
    this.target = [0, 0, 0];
    this.azimuth = -0.6;
    this.elevation = 0.45;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const [x, y] = this.flat ? reach : [1.5, 1.5];
    this.half = 1.06 * Math.max(y, (x * height) / Math.max(1, width));
    this.changed();
  }

  closeTo(place, half) {
    this.target = [...place];
    this.half = half;
    this.changed();
  }

  /** Right, up and towards the viewer, unit vectors. */
  axes() {
    if (this.flat) return [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    const [ca, sa, ce, se] = [Math.cos(this.azimuth), Math.sin(this.azimuth), Math.cos(this.elevation), Math.sin(this.elevation)];
    return [[ca, sa, 0], [sa * se, -ca * se, ce], [sa * ce, -ca * ce, se]];
  }

  /** Length of a pixel in the mesh's units. */
  get pixel() {
    return (2 * this.half) / Math.max(1, this.canvas.clientHeight);
  }

  shift(right, up) {
    const [x, y] = this.axes();
    this.target = this.target.map((value, k) => value + right * x[k] + up * y[k]);
    this.changed();
  }

  turn(azimuth, elevation) {
    this.azimuth += azimuth;
    this.elevation = Math.min(1.5, Math.max(-1.5, this.elevation + elevation));
    this.changed();
  }

  /** Zoom by a factor; the point at (x, y) pixels from the centre stays fixed. */
  zoom(factor, x = 0, y = 0) {
    const half = Math.min(10, Math.max(1e-5, this.half * factor));
    const kept = (1 - half / this.half) * this.pixel;
    this.half = half;
    this.shift(kept * x, -kept * y);
  }

  /** From pixels of the canvas: a point of the view's plane, and the direction away from the viewer. */
  ray(x, y) {
    const [right, up, back] = this.axes();
    const [dx, dy] = [(x - this.canvas.clientWidth / 2) * this.pixel, (this.canvas.clientHeight / 2 - y) * this.pixel];
    const origin = this.target.map((value, k) => value + dx * right[k] + dy * up[k] + 10 * back[k]);
    return { origin, direction: back.map((x) => -x) };
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    this.start = [event.offsetX, event.offsetY];
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.offsetX, event.offsetY];
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    if (this.pointers.size === 2) this.pinch(event.pointerId, before, now);
    else if (this.flat || event.shiftKey || event.buttons === 4) this.shift(-dx * this.pixel, dy * this.pixel);
    else this.turn(-dx * 0.008, dy * 0.008);
    this.pointers.set(event.pointerId, now);
  }

  pinch(id, before, now) {
    const [other] = [...this.pointers].filter(([key]) => key !== id).map(([, place]) => place);
    const distance = (place) => Math.hypot(place[0] - other[0], place[1] - other[1]);
    if (distance(now) > 1) this.zoom(distance(before) / distance(now));
  }

  up(event) {
    if (!this.pointers.delete(event.pointerId)) return; // pressed outside the canvas
    const moved = Math.hypot(event.offsetX - this.start[0], event.offsetY - this.start[1]);
    if (moved < CLICK_PIXELS) this.clicked(event.offsetX, event.offsetY);
  }

  wheel(event) {
    event.preventDefault();
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const pixels = event.deltaMode === 1 ? 30 * event.deltaY : event.deltaY;
    this.zoom(Math.exp(WHEEL * pixels), event.offsetX - width / 2, event.offsetY - height / 2);
  }

  /** Handle a key; return whether it was used. */
  key(event) {
    const step = KEY_STEP * this.half;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if (event.key in arrows) {
      const [x, y] = arrows[event.key];
      if (this.flat || event.shiftKey) this.shift(step * x, step * y);
      else this.turn(KEY_TURN * x, KEY_TURN * y);
    } else if (event.key === "+" || event.key === "=") this.zoom(0.8);
    else if (event.key === "-") this.zoom(1.25);
    else if (event.key === "0") this.fit(this.reach);
    else return false;
    return true;
  }
}
