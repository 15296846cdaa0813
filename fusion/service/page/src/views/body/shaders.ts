// What the graphics processor does with vertices and their values.

/** Stands for "unknown" in the attribute `value`: graphics processors need not know NaN. */
export const NOTHING = -3e38;

export const VERTEX = /* glsl */ `
in float value;
out vec3 vNormal;
out float vValue;
out float vKnown;
flat out float vCode;
void main() {
  vNormal = normal;
  vKnown = value > -1e38 ? 1.0 : 0.0;
  vValue = vKnown > 0.0 ? value : 0.0;
  vCode = value;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

// kind 0: no layer, 1: numbers, 2: codes, which are not mixed within a facet.
export const FRAGMENT = /* glsl */ `
precision highp float;
in vec3 vNormal;
in float vValue;
in float vKnown;
flat in float vCode;
uniform sampler2D table;
uniform vec2 range;
uniform vec3 light;
uniform vec3 plain;
uniform vec3 hatch;
uniform float shading;
uniform int kind;
out vec4 colour;
void main() {
  vec3 base = plain;
  bool known = kind == 2 ? vCode > -1e38 : vKnown > 0.999;
  if (kind > 0 && known) {
    float share = clamp(((kind == 2 ? vCode : vValue) - range.x) / (range.y - range.x), 0.0, 1.0);
    base = texture(table, vec2((share * 255.0 + 0.5) / 256.0, 0.5)).rgb;
  } else if (kind > 0) {
    float stripe = fract((gl_FragCoord.x + gl_FragCoord.y) / 9.0);
    base = stripe < 0.3 ? hatch : plain;
  }
  float lit = max(dot(normalize(vNormal), light), 0.0);
  colour = vec4(base * mix(1.0, (kind > 0 ? 0.3 + 0.8 * lit : 0.06 + 1.04 * lit), shading), 1.0);
}`;

/** The value, whether it is known, and the depth. */
export const PICK_FRAGMENT = /* glsl */ `
precision highp float;
in vec3 vNormal;
in float vValue;
in float vKnown;
flat in float vCode;
uniform int kind;
out vec4 found;
void main() {
  bool known = kind == 2 ? vCode > -1e38 : vKnown > 0.999;
  found = vec4(kind == 2 ? vCode : vValue, known ? 1.0 : 0.0, gl_FragCoord.z, 1.0);
}`;

export const LINE_VERTEX = /* glsl */ `
in vec3 outward;
uniform vec3 eye;
void main() {
  float vFacing = dot(outward, eye);
  // Both ends of a line have the same "outward": those of the far side are not drawn at all.
  gl_Position = vFacing < 0.12 ? vec4(2.0, 2.0, 2.0, 1.0) : projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

export const LINE_FRAGMENT = /* glsl */ `
precision highp float;
uniform vec3 ink;
uniform float opacity;
out vec4 colour;
void main() {
  colour = vec4(ink, opacity);
}`;

export const COPY_VERTEX = /* glsl */ `
in vec3 position;
void main() {
  gl_Position = vec4(position.xy, 0.0, 1.0);
}`;

export const COPY_FRAGMENT = /* glsl */ `
precision highp float;
uniform sampler2D picture;
out vec4 colour;
void main() {
  colour = texelFetch(picture, ivec2(gl_FragCoord.xy), 0);
}`;
