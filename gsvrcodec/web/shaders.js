/** The programs of the renderer (sections 8.2, 8.4 and 8.5), in GLSL ES 3.00. */

import {
  ANTIALIAS, CUTOFF, DILATION, MIN_SCALE, MIN_VARIANCE, MOST_LOG_OPACITY, UPSAMPLING,
} from "./reconstruction.js";

const HEAD = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
const float MIN_SCALE = ${MIN_SCALE.toFixed(8)};
const float CUTOFF = ${CUTOFF.toFixed(8)};
const float REACH = ${Math.sqrt(-2 * Math.log(CUTOFF)).toFixed(8)};  // sigmas where a Gaussian ends
const float MOST_LOG_OPACITY = ${MOST_LOG_OPACITY.toFixed(8)};
`;

/** A Gaussian, of whose quad the vertex is a corner. */
const DEFORM = `
uniform sampler2D gaussians;               // by four texels
vec4 place;                                // position, log_scale
vec4 appearance;                           // rotation, colour
vec4 motion;                               // log_opacity, indicator, linear
vec4 rest;                                 // quadratic, 1 = of the moving layer

uniform sampler2D gridXY, gridXT, gridYT;  // two texels a cell: channels 0-3 and 4-7
uniform vec3 gridSize;                     // Gx, Gy, Gt; 0 = no tri-plane
uniform float tau;
uniform bool isMean;

vec2 centre, scales;                       // mu; s, pixels of the coded frame
vec2 turn;                                 // cosine and sine of theta
vec3 colour;                               // c
float opacity;                             // 1 where pictures are sums

// Bilinear lookup of four channels: half 0 or 1.
vec4 lookup(sampler2D grid, vec2 at, int part) {
  ivec2 i = ivec2(floor(at));
  ivec2 j = min(i + 1, textureSize(grid, 0) / ivec2(2, 1) - 1);
  vec2 f = at - vec2(i);
  vec4 upper = mix(texelFetch(grid, ivec2(2 * i.x + part, i.y), 0),
                   texelFetch(grid, ivec2(2 * j.x + part, i.y), 0), f.x);
  vec4 lower = mix(texelFetch(grid, ivec2(2 * i.x + part, j.y), 0),
                   texelFetch(grid, ivec2(2 * j.x + part, j.y), 0), f.x);
  return mix(upper, lower, f.y);
}

// To 2^-22; those of a device may be as coarse as 2^-11. Sigma has period pi.
vec2 cosineAndSine(float angle) {
  float turns = round(angle * 0.31830988618);
  float x = (angle - turns * 3.140625) - turns * 9.67653589793e-4;
  float q = x * x;
  float c = 1.0 + q * (-0.5 + q * (4.16666666e-2 + q * (-1.38888889e-3 + q * (2.48015873e-5
            - q * 2.75573192e-7))));
  float s = x * (1.0 + q * (-1.66666667e-1 + q * (8.33333333e-3 + q * (-1.98412698e-4
            + q * (2.75573192e-6 - q * 2.50521084e-8)))));
  return vec2(c, s);
}

// Section 8.2.
void deform() {
  int row = textureSize(gaussians, 0).x / 4, number = gl_VertexID >> 2;
  ivec2 texel = ivec2(number % row * 4, number / row);
  place = texelFetch(gaussians, texel, 0);
  appearance = texelFetch(gaussians, texel + ivec2(1, 0), 0);
  motion = texelFetch(gaussians, texel + ivec2(2, 0), 0);
  rest = texelFetch(gaussians, texel + ivec2(3, 0), 0);
  vec4 shift = vec4(0.0), tint = vec4(0.0);
  if (gridSize.x > 0.0 && motion.y != 1.0) {
    vec3 last = gridSize - 1.0;
    vec3 at = clamp((vec3(place.xy, tau) + 1.0) / 2.0 * last, vec3(0.0), last);
    float share = 1.0 - motion.y;
    shift = share * lookup(gridXY, at.xy, 0) * lookup(gridXT, at.xz, 0) * lookup(gridYT, at.yz, 0);
    tint = share * lookup(gridXY, at.xy, 1) * lookup(gridXT, at.xz, 1) * lookup(gridYT, at.yz, 1);
  }
  centre = place.xy + motion.zw * tau + rest.xy * tau * tau + shift.xy;
  scales = max(exp(place.zw) + shift.zw, MIN_SCALE);
  turn = cosineAndSine(appearance.x + tint.x);
  colour = appearance.yzw + (isMean ? vec3(0.0) : tint.yzw);
  opacity = isMean ? exp(clamp(motion.x + tint.y, -MOST_LOG_OPACITY, MOST_LOG_OPACITY)) : 1.0;
}
`;

/** A Gaussian on its level (section 8.4): the quad beyond which it weighs nothing. */
export const SPLAT_VERTEX = `${HEAD}${DEFORM}
uniform vec2 frame;      // W, H
uniform vec2 zoom;       // W / Wc, H / Hc
uniform float side;      // of a pixel of the level, pixels of the frame: 2^l
uniform vec4 region;     // origin and size of the drawn part, pixels of the level
uniform float scale;     // of all weights

flat out vec2 at;        // pixels of the region
flat out vec4 toSigmas;  // rows of the matrix that turns pixels into sigmas
flat out vec4 factors;   // of the weight: of the colours, and of the weight itself

void main() {
  deform();
  float least = min(zoom.x, zoom.y);
  vec2 square = scales * scales, v;
  if (side == 1.0) {
    v = square + ${DILATION} + max(1.0 / (least * least) - 1.0, 0.0) * ${ANTIALIAS};
  } else {
    float area = side * side / (least * least);
    v = max(square - ${UPSAMPLING} * area, ${MIN_VARIANCE} * area);
  }
  vec2 ratio = (square + ${DILATION}) / v;
  factors = scale * opacity * sqrt(ratio.x * ratio.y) * vec4(colour, 1.0);

  vec2 sigma = sqrt(v), d = zoom / side;
  vec2 first = turn * d * sigma.x;
  vec2 second = vec2(-turn.y, turn.x) * d * sigma.y;
  float determinant = d.x * d.y * sigma.x * sigma.y;
  toSigmas = vec4(second.y, -second.x, -first.y, first.x) / determinant;
  at = (centre + 1.0) * frame / (2.0 * side) - region.xy;

  // And what devices round corners by.
  vec2 reach = REACH + 0.07 / vec2(length(first), length(second));
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1 & 1) * 2.0 - 1.0;
  vec2 pixel = at + corner.x * reach.x * first + corner.y * reach.y * second;
  gl_Position = vec4(pixel / region.zw * 2.0 - 1.0, 0.0, 1.0);
}
`;

/** What a Gaussian adds to the sums of a pixel (section 8.5). */
export const SPLAT_FRAGMENT = `${HEAD}
flat in vec2 at;
flat in vec4 toSigmas;
flat in vec4 factors;
out vec4 sum;

void main() {
  vec2 d = gl_FragCoord.xy - at;
  vec2 u = vec2(dot(toSigmas.xy, d), dot(toSigmas.zw, d));
  sum = factors * max(exp(-0.5 * dot(u, u)) - CUTOFF, 0.0);
}
`;

/** A triangle that covers the target. */
export const COVER_VERTEX = `${HEAD}
void main() {
  gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}
`;

/** up() of section 8.5 at one pixel. */
const UP = `
vec4 up(sampler2D coarse, ivec2 pixel, ivec2 size) {
  ivec2 near = pixel >> 1;
  ivec2 far = clamp(near + (pixel & 1) * 2 - 1, ivec2(0), size - 1);
  vec4 a = texelFetch(coarse, near, 0) * 0.75 + texelFetch(coarse, ivec2(far.x, near.y), 0) * 0.25;
  vec4 b = texelFetch(coarse, ivec2(near.x, far.y), 0) * 0.75 + texelFetch(coarse, far, 0) * 0.25;
  return a * 0.75 + b * 0.25;
}
`;

/** Adds a magnified level to the next finer one. */
export const UP_FRAGMENT = `${HEAD}${UP}
uniform sampler2D coarse;
uniform ivec2 coarseSize;
out vec4 sum;

void main() {
  sum = up(coarse, ivec2(gl_FragCoord.xy), coarseSize);
}
`;

/** What a plate adds to the sums of a pixel (section 8.5). */
export const PLATE_FRAGMENT = `${HEAD}
uniform sampler2D plate;
uniform bool isYcc;
uniform vec2 origin;     // of the drawn part, pixels of the frame
uniform vec2 ratio;      // Wc / W, Hc / H
uniform float scale;     // weight of each pixel
out vec4 sum;

void main() {
  vec2 at = (gl_FragCoord.xy + origin) * ratio - 0.5, reach = max(ratio, 1.0);
  ivec2 first = max(ivec2(ceil(at - reach)), 0), k;
  ivec2 last = min(ivec2(floor(at + reach)), textureSize(plate, 0) - 1);
  vec4 total = vec4(0.0);
  for (k.y = first.y; k.y <= last.y; k.y++) {
    for (k.x = first.x; k.x <= last.x; k.x++) {
      vec2 weight = max(1.0 - abs(vec2(k) - at) / reach, 0.0);
      total += weight.x * weight.y * vec4(texelFetch(plate, k, 0).rgb, 1.0);
    }
  }
  vec3 c = total.rgb / total.a;
  if (isYcc) {
    c.yz -= 128.0 / 255.0;
    c = c.x + vec3(1.402 * c.z, -0.344136 * c.y - 0.714136 * c.z, 1.772 * c.y);
  }
  sum = scale * vec4(c, 1.0);
}
`;

/** The codes of a picture, turned and moved to its place on the screen. */
export const SCREEN_FRAGMENT = `${HEAD}
uniform sampler2D still, changing;
uniform ivec4 turning;   // columns of the matrix from pixels of the screen to those of the region
uniform ivec2 shift;     // added after it
uniform ivec2 size;      // of the region
uniform int height;      // of the screen
uniform bool isMean;
uniform float ground;    // its weight, by the scale of all weights
uniform float opacity;
out vec4 code;

void main() {
  ivec2 screen = ivec2(gl_FragCoord.x, float(height) - gl_FragCoord.y);
  ivec2 pixel = screen.x * turning.xy + screen.y * turning.zw + shift;
  if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, size))) discard;
  vec4 sums = texelFetch(still, pixel, 0) + texelFetch(changing, pixel, 0);
  vec3 picture = isMean ? sums.rgb / (ground + sums.a) : sums.rgb;
  code = vec4(floor(255.0 * clamp(picture, 0.0, 1.0) + 0.5) / 255.0, opacity);
}
`;

/** The ellipse of one sigma of a Gaussian, on the screen. */
export const OUTLINE_VERTEX = `${HEAD}${DEFORM}
uniform vec2 frame;
uniform vec2 zoom;
uniform vec4 turning;    // columns of the matrix from pixels of the frame to those of the screen
uniform vec2 shift;
uniform vec2 screen;     // size, pixels

out vec2 u;              // sigmas
flat out vec4 ink;

void main() {
  deform();
  ink = mix(vec4(0.2, 0.8, 1.0, 0.6), vec4(1.0, 0.7, 0.0, 0.8), rest.z);
  vec2 first = turn * zoom * scales.x;
  vec2 second = vec2(-turn.y, turn.x) * zoom * scales.y;
  vec2 reach = 1.0 + 2.0 / vec2(length(first), length(second));
  u = (vec2(gl_VertexID & 1, gl_VertexID >> 1 & 1) * 2.0 - 1.0) * reach;
  vec2 pixel = (centre + 1.0) * frame / 2.0 + u.x * first + u.y * second;
  pixel = pixel.x * turning.xy + pixel.y * turning.zw + shift;
  gl_Position = vec4((pixel / screen * 2.0 - 1.0) * vec2(1.0, -1.0), 0.0, 1.0);
}
`;

export const OUTLINE_FRAGMENT = `${HEAD}
in vec2 u;
flat in vec4 ink;
out vec4 code;

void main() {
  float r = length(u);
  code = vec4(ink.rgb, ink.a * clamp(1.0 - abs(r - 1.0) / max(fwidth(r), 1e-6), 0.0, 1.0));
}
`;
