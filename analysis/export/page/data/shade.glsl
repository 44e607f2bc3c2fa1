#version 300 es
// What `Result.render` computes, of one pixel of the area: the models of analysis/reflectance, letter by letter.
precision highp float; precision highp int;
precision highp sampler2D; precision highp usampler2D; precision highp sampler2DArray;

uniform usampler2D normals, heights, facts, lists, columns;
uniform sampler2D weights, models, nodes;
uniform sampler2DArray tables;
uniform vec3 camera, light;
uniform vec2 first_mm, heights_mm;
uniform float spacing_mm, albedo_angle;
uniform int layer, n_materials;
out vec4 shown;

const float PI = 3.141592653589793, GRAZING = 0.01;
const int RELIT = 0, NORMALS = 1, ALBEDO = 2, MATERIALS = 3, SIGMA = 4, HEIGHT = 5;

// The angles of analysis.reflectance.models.Cosines. t = sqrt(1 - n.h) and theta_d come from differences of vectors,
// since a cosine near 1 has no digits left in 32 bits.
struct Angles { float t, theta_d, cos_d, n_dot_l, n_dot_v; };

Angles angles_of(vec3 n, vec3 omega_i, vec3 omega_o) {
  vec3 h = normalize(omega_i + omega_o);
  return Angles(min(length(n - h) * sqrt(0.5), sqrt(1.0 - GRAZING)),
                min(2.0 * asin(min(0.5 * length(omega_i - h), 1.0)), 0.5 * PI), clamp(dot(omega_i, h), 0.0, 1.0),
                clamp(dot(n, omega_i), GRAZING, 1.0), clamp(dot(n, omega_o), GRAZING, 1.0));
}

Angles on_slice(float theta_h) {
  float c = max(cos(theta_h), GRAZING);
  return Angles(min(sqrt(2.0) * sin(0.5 * theta_h), sqrt(1.0 - GRAZING)), 0.0, 1.0, c, c);
}

// Node below x and how far on to the next one it is.
void bracket(float x, int row, int n, out int i, out float u) {
  i = 0; u = 0.0;
  if (n < 2) return;
  int above = n - 1;
  while (above - i > 1) { int middle = (i + above) / 2; if (texelFetch(nodes, ivec2(middle, row), 0).r <= x) i = middle; else above = middle; }
  float a = texelFetch(nodes, ivec2(i, row), 0).r, b = texelFetch(nodes, ivec2(i + 1, row), 0).r;
  u = clamp((x - a) / (b - a), 0.0, 1.0);
}

vec3 table(Angles q, int k, int n_h, int n_d) {
  int i, j; float u, v;
  bracket(q.t, 2 * k, n_h, i, u);
  bracket(q.theta_d, 2 * k + 1, n_d, j, v);
  int i_next = min(i + 1, n_h - 1), j_next = min(j + 1, n_d - 1);
  vec3 low = mix(texelFetch(tables, ivec3(i, j, k), 0).rgb, texelFetch(tables, ivec3(i, j_next, k), 0).rgb, v);
  vec3 high = mix(texelFetch(tables, ivec3(i_next, j, k), 0).rgb, texelFetch(tables, ivec3(i_next, j_next, k), 0).rgb, v);
  return mix(low, high, u);
}

float ggx_visibility(float x, float alpha) { return 1.0 / (x + sqrt(alpha * alpha + (1.0 - alpha * alpha) * x * x)); }

float lobe(Angles q, float alpha, float gamma) {
  float s2 = q.t * q.t * (2.0 - q.t * q.t), c = 1.0 - q.t * q.t;
  float u = 1.0 - s2 + s2 / (alpha * alpha), rough = min(alpha, 1.0), peak = ggx_visibility(c, rough);
  float v = ggx_visibility(q.n_dot_l, rough) * ggx_visibility(q.n_dot_v, rough);
  float fresnel = (0.04 + 0.96 * pow(1.0 - q.cos_d, 5.0)) / 0.04;
  return pow(u, -gamma) * fresnel * v / (peak * peak);
}

float sgd_shadow(float x, float lambda, float log_c, float k, float theta_0) {
  float beyond = acos(x) - theta_0;
  if (beyond <= 0.0) return 1.0;
  float e = exp(min(log_c + k * log(beyond), 80.0));
  float grown = e < 0.01 ? e * (1.0 + e * (0.5 + e / 6.0)) : exp(min(e, 80.0)) - 1.0;
  return clamp(1.0 - lambda * grown, 0.0, 1.0);
}

float sgd(Angles q, vec4 a, vec4 b, vec4 c) {
  float cos_h = 1.0 - q.t * q.t, cos_h2 = cos_h * cos_h, sin_h2 = q.t * q.t * (2.0 - q.t * q.t);
  float ax = a.z + sin_h2 / cos_h2 / a.z;
  float D = exp(b.z - ax - a.w * log(ax)) / (PI * cos_h2 * cos_h2);
  float F = b.x - b.y * q.cos_d + (1.0 - b.x) * pow(1.0 - q.cos_d, 5.0);
  float G = sgd_shadow(q.n_dot_l, b.w, c.x, c.y, c.z) * sgd_shadow(q.n_dot_v, b.w, c.x, c.y, c.z);
  return a.x / PI + a.y / PI * F * D * G / (q.n_dot_l * q.n_dot_v);
}

float fresnel_dielectric(float cos_d, float ior) {
  float g = sqrt(max(ior * ior - 1.0 + cos_d * cos_d, 0.0));
  float s = (cos_d - g) / (cos_d + g), p = (ior * ior * cos_d - g) / (ior * ior * cos_d + g);
  return 0.5 * (s * s + p * p);
}

float abc(Angles q, vec4 a, float ior) {
  float D = pow(1.0 + a.z * q.t * q.t, -a.w), F = fresnel_dielectric(q.cos_d, ior);
  float G = min(1.0, 2.0 * (1.0 - q.t * q.t) * min(q.n_dot_l, q.n_dot_v) / max(q.cos_d, GRAZING));
  return a.x / PI + a.y * F * D * G / (PI * q.n_dot_l * q.n_dot_v);
}

// Numbers of the models: analysis/export/page/columns.py.
vec3 column(Angles q, int k) {
  vec4 head = texelFetch(models, ivec2(0, k), 0), a = texelFetch(models, ivec2(1, k), 0);
  int model = int(head.x);
  if (model == 0) return table(q, int(head.y), int(head.z), int(head.w));
  float f = 1.0 / PI, away = q.t * q.t;
  if (model == 2) f *= 1.0 - away;
  else if (model == 3) f *= pow(away, 5.0);
  else if (model == 4) f *= away;
  else if (model == 5) f *= inversesqrt(q.n_dot_l * q.n_dot_v);
  else if (model == 6) f /= q.n_dot_l * q.n_dot_v;
  else if (model == 7) f /= 1.0 + exp(min((2.0 * asin(q.t * sqrt(0.5)) - a.x) / a.y, 80.0));
  else if (model == 8) f = lobe(q, a.x, a.y);
  else if (model == 9) f = sgd(q, a, texelFetch(models, ivec2(2, k), 0), texelFetch(models, ivec2(3, k), 0));
  else if (model == 10) f = abc(q, a, texelFetch(models, ivec2(2, k), 0).x);
  return vec3(f);
}

ivec2 place(uint entry) { int width = textureSize(columns, 0).x; return ivec2(int(entry) % width, int(entry) / width); }

vec3 brdf(ivec2 p, Angles q) {
  uvec2 list = texelFetch(lists, p, 0).rg;
  vec3 f = vec3(0.0);
  for (uint e = list.x; e < list.x + list.y; e++) {
    int k = int(texelFetch(columns, place(e), 0).r);
    f += texelFetch(weights, place(e), 0).rgb * texelFetch(models, ivec2(4, k), 0).a * column(q, k);
  }
  return f;
}

// The materials' colours by their shares; grey where a pixel has atoms of its own.
vec3 material_colour(ivec2 p) {
  uvec2 list = texelFetch(lists, p, 0).rg;
  vec3 colour = vec3(0.0); float total = 0.0;
  for (uint e = list.x; e < list.x + list.y; e++) {
    int k = int(texelFetch(columns, place(e), 0).r);
    vec4 last = texelFetch(models, ivec2(4, k), 0);
    float share = texelFetch(weights, place(e), 0).r * last.a;
    if (k >= n_materials) return vec3(0.15);
    colour += share * last.rgb; total += share;
  }
  return total > 0.0 ? colour / total : vec3(0.15);
}

vec3 normal_at(ivec2 p) {
  vec2 o = vec2(texelFetch(normals, p, 0).rg) / 32767.0 - 1.0;
  float z = 1.0 - abs(o.x) - abs(o.y);
  if (z < 0.0) o = (1.0 - abs(o.yx)) * vec2(o.x < 0.0 ? -1.0 : 1.0, o.y < 0.0 ? -1.0 : 1.0);
  return normalize(vec3(o, z));
}

void main() {
  ivec2 p = ivec2(gl_FragCoord.xy);  // row 0 of the texture is the first row of the area
  uvec4 fact = texelFetch(facts, p, 0);
  if (fact.r == 0u) { shown = vec4(0.0); return; }
  vec3 n = normal_at(p);
  float share = float(texelFetch(heights, p, 0).r) / 65535.0;
  vec3 point = vec3(first_mm + spacing_mm * vec2(p.x, -p.y), mix(heights_mm.x, heights_mm.y, share));
  shown.a = 1.0;
  if (layer == NORMALS) shown.rgb = 0.5 * n + 0.5;
  else if (layer == ALBEDO) shown.rgb = PI * brdf(p, on_slice(albedo_angle * float(fact.b) / 255.0));
  else if (layer == MATERIALS) shown.rgb = material_colour(p);
  else if (layer == SIGMA) shown.rgb = vec3(float(fact.g) / 255.0);
  else if (layer == HEIGHT) shown.rgb = vec3(share);
  else {
    vec3 to_light = light - point, omega_o = normalize(camera - point);
    float d2 = dot(to_light, to_light);
    vec3 omega_i = to_light * inversesqrt(d2);
    float n_dot_l = dot(n, omega_i);
    bool is_lit = n_dot_l > 0.0 && dot(n, omega_o) > 0.0;
    shown.rgb = is_lit ? brdf(p, angles_of(n, omega_i, omega_o)) * n_dot_l / d2 : vec3(0.0);
  }
}
