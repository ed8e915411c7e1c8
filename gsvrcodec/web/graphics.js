/** Programs, textures and targets of WebGL 2. */

import { GsvrError } from "./errors.js";

export class Program {
  constructor(gl, vertex, fragment) {
    this.gl = gl;
    this.program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
      gl.deleteShader(shader);
    }
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS) && !gl.isContextLost()) {
      const shaders = gl.getAttachedShaders(this.program);
      const reason = shaders.map((shader) => gl.getShaderInfoLog(shader)).join(" ").trim();
      throw new GsvrError(`The graphics device does not take the renderer's programs: ${reason}`);
    }
    this.places = new Map();
  }

  /** Use the program; uniforms are `{ name: [function of WebGL, ...values] }`. */
  use(uniforms) {
    const { gl } = this;
    gl.useProgram(this.program);
    for (const [name, [set, ...values]] of Object.entries(uniforms)) {
      if (!this.places.has(name)) {
        this.places.set(name, gl.getUniformLocation(this.program, name));
      }
      gl[set](this.places.get(name), ...values);
    }
  }
}

/** The unit of textures while they are made. */
const WORKBENCH = 7;

/** A texture that is read texel by texel, of `values`, four floats or bytes each, or null. */
export function makeTexture(gl, format, width, height, values = null) {
  if (Math.max(width, height) > gl.getParameter(gl.MAX_TEXTURE_SIZE)) {
    throw new GsvrError(`A table of ${width}x${height} is too large for this device.`);
  }
  const texture = gl.createTexture();
  bindTexture(gl, WORKBENCH, texture);
  gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
    gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
  }
  if (values) {
    const type = values instanceof Uint8Array ? gl.UNSIGNED_BYTE : gl.FLOAT;
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RGBA, type, values);
  }
  return texture;
}

export function bindTexture(gl, unit, texture) {
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(gl.TEXTURE_2D, texture);
}

/** Quads: vertex `v` is corner `v % 4` of quad `v / 4`. Instances are slow without a GPU. */
export class Quads {
  constructor(gl) {
    this.gl = gl;
    this.array = gl.createVertexArray();
    this.indices = gl.createBuffer();
    this.count = 0;
  }

  reserve(count) {
    if (count <= this.count) return;
    const { gl } = this;
    this.count = Math.max(count, 2 * this.count);
    const indices = new Uint32Array(6 * this.count);
    for (let vertex = 0, at = 0; at < indices.length; vertex += 4, at += 6) {
      indices[at] = vertex;
      indices[at + 1] = indices[at + 3] = vertex + 1;
      indices[at + 2] = indices[at + 4] = vertex + 2;
      indices[at + 5] = vertex + 3;
    }
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.indices);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
  }

  /** Draw the quads from `first` up to `end`. */
  draw(first, end) {
    const { gl } = this;
    gl.bindVertexArray(this.array);
    gl.drawElements(gl.TRIANGLES, 6 * (end - first), gl.UNSIGNED_INT, 24 * first);
  }
}

/** A texture to draw sums into. It grows; its first columns and rows are in use. */
export class Target {
  constructor(gl, format) {
    this.gl = gl;
    this.format = format;
    this.framebuffer = gl.createFramebuffer();
    this.texture = null;
    this.allocated = [0, 0];
    this.size = [0, 0];
  }

  /** Set the size in use, make the target black, and direct drawing into it. */
  begin(width, height) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    if (width > this.allocated[0] || height > this.allocated[1]) {
      gl.deleteTexture(this.texture);
      this.allocated = [width, height].map(
        (side, axis) => Math.ceil(Math.max(side, this.allocated[axis]) / 64) * 64);
      this.texture = makeTexture(gl, this.format, ...this.allocated);
      gl.framebufferTexture2D(
        gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.texture, 0);
    }
    this.size = [width, height];
    gl.viewport(0, 0, width, height);
    gl.scissor(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
  }

  dispose() {
    this.gl.deleteFramebuffer(this.framebuffer);
    this.gl.deleteTexture(this.texture);
  }
}

/** Return the format of targets: 32-bit floats where the device adds them up, else 16-bit ones. */
export function targetFormat(gl, wantedBits = 32) {
  const floats = gl.getExtension("EXT_color_buffer_float");
  if (wantedBits === 32 && floats && gl.getExtension("EXT_float_blend")) {
    return { format: gl.RGBA32F, bits: 32 };
  }
  if (floats || gl.getExtension("EXT_color_buffer_half_float")) {
    return { format: gl.RGBA16F, bits: 16 };
  }
  throw new GsvrError(
    "This device cannot draw into floating-point pictures, which the player needs; "
    + "convert the film with gsvrdec to watch it here.");
}
