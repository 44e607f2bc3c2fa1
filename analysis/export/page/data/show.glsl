#version 300 es
// The shaded area on its tilted plane: exposure and the display's curve.
precision highp float;
uniform sampler2D area;
uniform float gain;
uniform bool is_colour;  // a layer that is a colour already
in vec2 place;
out vec4 colour;

void main() {
  vec4 texel = texture(area, place);
  if (texel.a < 0.5) { colour = vec4(0.16, 0.12, 0.16, 1.0); return; }
  vec3 v = clamp(texel.rgb / texel.a * gain, 0.0, 1.0);
  vec3 curved = mix(12.92 * v, 1.055 * pow(v, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, v));
  colour = vec4(is_colour ? v : curved, 1.0);
}
