#version 300 es
uniform mat4 plane;
in vec2 corner;
out vec2 place;

void main() {
  place = vec2(0.5 * corner.x + 0.5, 0.5 - 0.5 * corner.y);
  gl_Position = plane * vec4(corner, 0.0, 1.0);
}
