/** Draws Gaussians at any time and size with WebGL 2 (sections 8.2, 8.4 and 8.5). */

import {
  CHANNELS, INDICATOR, isStill, LOG_OPACITY, LOG_SCALE, OPACITY_CHANNEL, SLOTS,
} from "./attributes.js";
import { GsvrError } from "./errors.js";
import { bindTexture, makeTexture, Program, Quads, Target, targetFormat } from "./graphics.js";
import { GROUND, LEVELS, MOST_LOG_OPACITY, PLATE_WEIGHT } from "./reconstruction.js";
import {
  COVER_VERTEX, OUTLINE_FRAGMENT, OUTLINE_VERTEX, PLATE_FRAGMENT, SCREEN_FRAGMENT, SPLAT_FRAGMENT,
  SPLAT_VERTEX, UP_FRAGMENT,
} from "./shaders.js";

/** Texels of a Gaussian: its slots, and whether it is of the moving layer. */
const TEXELS = 4;
/** Largest sum of opacities in a target; 16-bit floats reach to twice as much. */
const MOST_SUM = 2 ** 15;
/** Gaussians of the largest opacity that may lie one upon the other. */
const MOST_LAYERS = 64;
/** Groups: still ones by level, then others by level; this one is not drawn. */
const UNUSED = 2 * LEVELS;

/** Return the most by which a tri-plane raises a log-opacity (section 8.2). */
function largestBend({ xy, xt, yt }) {
  return [xy, xt, yt].reduce((product, grid) => {
    let most = 0;
    for (let at = OPACITY_CHANNEL; at < grid.length; at += CHANNELS) {
      most = Math.max(most, Math.abs(grid[at]));
    }
    return product * most;
  }, 1);
}

/** A GOP on the device, or a passage. */
export class Scene {
  /** `gop` is as `RemoteFilm.gop` returns it; `pts` have no use. */
  constructor(renderer, gop) {
    const { gl, format, black, quads } = renderer;
    this.gl = gl;
    this.renderer = renderer;
    this.plate = gop.plate && renderer.hold(gop.plate);
    this.gaussians = gop.gaussians;
    this.isMoving = gop.moving;
    this.isOut = gop.out;
    this.isMean = gop.blending === "mean";
    this.count = gop.gaussians.length / SLOTS;
    this.moving = this.isMoving.reduce((sum, each) => sum + each, 0);
    this.table = null;
    this.gridSize = gop.grids ? gop.grids.size : [0, 0, 0];
    this.grids = gop.grids ? this.upload(gop.grids) : [];
    this.bend = gop.grids ? largestBend(gop.grids) : 0;
    this.black = black;
    this.quads = quads;
    this.arranged = "";
    this.starts = null;
    this.still = new Target(gl, format);
    this.stillKey = "";
  }

  upload({ size: [gx, gy, gt], xy, xt, yt }) {
    return [[gx, gy, xy], [gx, gt, xt], [gy, gt, yt]].map(([columns, rows, values]) =>
      makeTexture(this.gl, this.gl.RGBA32F, 2 * columns, rows, values));
  }

  /** Replace the Gaussians, as many as before: a mix of two looks. */
  replace(gaussians) {
    this.gaussians = gaussians;
    this.arranged = "";
    this.stillKey = "";
  }

  /** Return the factor of all weights, a power of two, with which sums fit in targets. */
  chooseScale() {
    if (!this.isMean) return 1;
    const { gaussians, bend } = this;
    let largest = this.plate ? PLATE_WEIGHT : Math.exp(-MOST_LOG_OPACITY), total = largest;
    for (let at = 0; at < gaussians.length; at += SLOTS) {
      const log = gaussians[at + LOG_OPACITY] + Math.abs(1 - gaussians[at + INDICATOR]) * bend;
      const opacity = Math.exp(Math.min(log, MOST_LOG_OPACITY));
      if (opacity > largest) largest = opacity;
      total += opacity;
    }
    return 2 ** Math.floor(Math.log2(MOST_SUM / Math.min(total, MOST_LAYERS * largest)));
  }

  /** Sort the Gaussians of some layers by level at `zoom` (section 8.4), still ones first. */
  arrange(zoom, layers) {
    const key = `${zoom} ${layers}`;
    if (key === this.arranged) return;
    this.arranged = key;
    this.scale = this.chooseScale();
    const { gaussians, isMoving, isOut, count, gl } = this;
    const bounds = [1, 2, 3, 4].map((level) => Math.fround(Math.log(2 ** level / zoom)));
    const wanted = { all: [1, 1], standing: [1, 0], moving: [0, 1] }[layers];
    const group = new Uint8Array(count).fill(UNUSED);
    const starts = new Uint32Array(UNUSED + 1);
    for (let n = 0, at = 0; n < count; n++, at += SLOTS) {
      if (!wanted[isMoving[n]] || isOut?.[n]) continue;
      const smaller = Math.min(gaussians[at + LOG_SCALE], gaussians[at + LOG_SCALE + 1]);
      let level = 0;
      while (level < 4 && smaller >= bounds[level]) level++;
      group[n] = isStill(gaussians, at) ? level : LEVELS + level;
      starts[group[n] + 1]++;
    }
    for (let g = 0; g < UNUSED; g++) starts[g + 1] += starts[g];
    this.starts = [...starts];
    const side = TEXELS * Math.ceil(Math.sqrt(Math.max(1, starts[UNUSED]) / TEXELS));
    const sorted = new Float32Array(4 * side * side);
    for (let n = 0, at = 0; n < count; n++, at += SLOTS) {
      if (group[n] === UNUSED) continue;
      const place = starts[group[n]]++ * 4 * TEXELS;
      sorted.set(gaussians.subarray(at, at + SLOTS), place);
      sorted[place + SLOTS] = isMoving[n];
    }
    this.quads.reserve(starts[UNUSED]);
    gl.deleteTexture(this.table);
    this.table = makeTexture(gl, gl.RGBA32F, side, side, sorted);
  }

  drawGroups(first, end) {
    this.quads.draw(this.starts[first], this.starts[end]);
  }

  /** Bind the textures of Gaussians; return their uniforms at a time. */
  deformation(tau) {
    for (const unit of [0, 1, 2]) bindTexture(this.gl, unit, this.grids[unit] ?? this.black);
    bindTexture(this.gl, 5, this.table);
    return {
      gaussians: ["uniform1i", 5],
      gridXY: ["uniform1i", 0],
      gridXT: ["uniform1i", 1],
      gridYT: ["uniform1i", 2],
      gridSize: ["uniform3f", ...this.gridSize],
      tau: ["uniform1f", tau],
      isMean: ["uniform1i", this.isMean],
    };
  }

  dispose() {
    this.gl.deleteTexture(this.table);
    this.grids.forEach((grid) => this.gl.deleteTexture(grid));
    this.still.dispose();
    if (this.plate) this.renderer.release(this.plate);
  }
}

/** Draws scenes on a canvas. */
export class Renderer {
  /** Throws a `GsvrError` where it cannot. `bits` of 16 asks for 16-bit targets. */
  constructor(canvas, { bits = 32 } = {}) {
    const options = {
      alpha: false, antialias: false, depth: false, powerPreference: "high-performance",
    };
    const gl = canvas.getContext("webgl2", options);
    if (!gl) {
      throw new GsvrError(
        "This browser has no WebGL 2, which the player needs; try another browser, "
        + "or switch hardware acceleration on in its settings.");
    }
    this.gl = gl;
    const target = targetFormat(gl, bits);
    this.format = target.format;
    this.bits = target.bits;
    this.splat = new Program(gl, SPLAT_VERTEX, SPLAT_FRAGMENT);
    this.magnify = new Program(gl, COVER_VERTEX, UP_FRAGMENT);
    this.addPlate = new Program(gl, COVER_VERTEX, PLATE_FRAGMENT);
    this.toScreen = new Program(gl, COVER_VERTEX, SCREEN_FRAGMENT);
    this.outline = new Program(gl, OUTLINE_VERTEX, OUTLINE_FRAGMENT);
    this.levels = Array.from({ length: LEVELS }, () => new Target(gl, this.format));
    this.black = makeTexture(gl, gl.RGBA8, 1, 1);
    this.cover = gl.createVertexArray();
    this.quads = new Quads(gl);
    this.plates = new Map(); // of scenes, with their textures
    gl.enable(gl.SCISSOR_TEST);
    gl.disable(gl.DITHER);
  }

  scene(gop) {
    return new Scene(this, gop);
  }

  /** Return a plate with its texture, which its users share; each has to release it. */
  hold(plate) {
    const { gl, plates } = this, { width, height, texels } = plate;
    const held = plates.get(plate)
      ?? { plate, users: 0, texture: makeTexture(gl, gl.RGBA8, width, height, texels) };
    held.users++;
    plates.set(plate, held);
    return held;
  }

  release(held) {
    if (--held.users) return;
    this.plates.delete(held.plate);
    this.gl.deleteTexture(held.texture);
  }

  /** Make the screen black. */
  clear() {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
    gl.scissor(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
  }

  /** Return codes of the screen, RGBA, from the lowest row up. */
  read(x, y, width, height) {
    const { gl } = this;
    const codes = new Uint8Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(x, y, width, height, gl.RGBA, gl.UNSIGNED_BYTE, codes);
    return codes;
  }

  /**
   * Draw a scene at a time over the screen; its codes weigh `opacity`. `layers` is "all", "moving"
   * or "standing".
   */
  draw(scene, tau, view, { layers = "all", opacity = 1 } = {}) {
    if (view.isEmpty) return;
    scene.arrange(Math.min(...view.zoom), layers);
    // Still Gaussians and the plate are drawn once for all frames.
    const key = [layers, ...view.frame, ...view.region].join();
    if (scene.stillKey !== key) {
      this.drawPyramid(scene, 0, 0, view, scene.still);
      if (scene.plate && layers !== "moving") this.drawPlate(scene, view);
      scene.stillKey = key;
    }
    const changes = scene.starts[UNUSED] > scene.starts[LEVELS];
    if (changes) this.drawPyramid(scene, tau, LEVELS, view, this.levels[0]);
    this.drawToScreen(scene, changes ? this.levels[0] : null, view, opacity);
  }

  /** Sum up the five groups from `firstGroup` on, in `picture` (section 8.5). */
  drawPyramid(scene, tau, firstGroup, view, picture) {
    const { gl } = this;
    const [x0, y0, x1, y1] = view.region;
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE);
    const deformation = scene.deformation(tau);
    let coarse = null;
    for (let level = LEVELS - 1; level >= 0; level--) {
      const group = firstGroup + level, side = 2 ** level;
      const isUsed = scene.starts[group + 1] > scene.starts[group];
      if (!isUsed && !coarse && level > 0) continue;
      const target = level === 0 ? picture : this.levels[level];
      const size = [Math.ceil(x1 / side) - x0 / side, Math.ceil(y1 / side) - y0 / side];
      target.begin(...size);
      if (isUsed) {
        this.splat.use({
          ...deformation,
          frame: ["uniform2f", ...view.frame],
          zoom: ["uniform2f", ...view.zoom],
          side: ["uniform1f", side],
          region: ["uniform4f", x0 / side, y0 / side, ...size],
          scale: ["uniform1f", scene.scale],
        });
        scene.drawGroups(group, group + 1);
      }
      if (coarse) {
        bindTexture(gl, 3, coarse.texture);
        this.magnify.use({ coarse: ["uniform1i", 3], coarseSize: ["uniform2i", ...coarse.size] });
        this.drawCover();
      }
      coarse = target;
    }
  }

  /** Add the plate to the still Gaussians, which were just drawn. */
  drawPlate({ plate: { plate, texture }, scale }, view) {
    const [x0, y0] = view.region;
    bindTexture(this.gl, 3, texture);
    this.addPlate.use({
      plate: ["uniform1i", 3],
      isYcc: ["uniform1i", plate.isYcc],
      origin: ["uniform2f", x0, y0],
      ratio: ["uniform2f", plate.width / view.frame[0], plate.height / view.frame[1]],
      scale: ["uniform1f", PLATE_WEIGHT * scale],
    });
    this.drawCover();
  }

  drawCover() {
    this.gl.bindVertexArray(this.cover);
    this.gl.drawArrays(this.gl.TRIANGLES, 0, 3);
  }

  drawToScreen({ still, isMean, scale }, changing, view, opacity) {
    const { gl } = this;
    const [x0, y0, x1, y1] = view.region;
    const [xx, xy, yx, yy] = view.columns;
    // The transpose of the matrix leads back. Pixels are sampled at half a pixel.
    const back = (axisX, axisY, origin) => Math.floor(
      axisX * (0.5 - view.shift[0]) + axisY * (0.5 - view.shift[1])) - origin;
    this.onScreen();
    bindTexture(gl, 3, still.texture);
    bindTexture(gl, 4, changing ? changing.texture : this.black);
    this.toScreen.use({
      still: ["uniform1i", 3],
      changing: ["uniform1i", 4],
      turning: ["uniform4i", xx, yx, xy, yy],
      shift: ["uniform2i", back(xx, xy, x0), back(yx, yy, y0)],
      size: ["uniform2i", x1 - x0, y1 - y0],
      height: ["uniform1i", view.screen[1]],
      isMean: ["uniform1i", isMean],
      ground: ["uniform1f", GROUND * scale],
      opacity: ["uniform1f", opacity],
    });
    this.drawCover();
  }

  /** Draw the ellipses of one sigma over the picture. */
  drawOutlines(scene, tau, view, { layers = "all" } = {}) {
    if (view.isEmpty) return;
    scene.arrange(Math.min(...view.zoom), layers);
    this.onScreen();
    this.outline.use({
      ...scene.deformation(tau),
      frame: ["uniform2f", ...view.frame],
      zoom: ["uniform2f", ...view.zoom],
      turning: ["uniform4f", ...view.columns],
      shift: ["uniform2f", ...view.shift],
      screen: ["uniform2f", ...view.screen],
    });
    scene.drawGroups(0, UNUSED);
  }

  /** Direct drawing to the screen; it is mixed in by its opacity. */
  onScreen() {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
    gl.scissor(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }
}
