"use strict";
const byId = (id) => document.getElementById(id);
const meta = JSON.parse(byId("meta").textContent);
const { width, height } = meta;
const LAYERS = ["relit", "normals", "albedo", "materials", "sigma", "height"];
const DEGREE = Math.PI / 180;

// ---- The data: base64, deflate, planes of bytes, of maps their differences along rows (analysis/export/page/planes.py).

async function unpacked() {
  const text = atob(byId("data").textContent.trim());
  const deflated = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) deflated[i] = text.charCodeAt(i);
  byId("data").remove();
  const stream = new Blob([deflated]).stream().pipeThrough(new DecompressionStream("deflate"));
  const raw = new Uint8Array(await new Response(stream).arrayBuffer());
  const arrays = {};
  let at = 0;
  for (const { name, kind, shape: [rows, columns, planes], differences } of meta.arrays) {
    const size = { uint8: 1, uint16: 2, float32: 4 }[kind];
    const bytes = new Uint8Array(rows * columns * planes * size);
    for (let plane = 0; plane < planes; plane++)
      for (let k = 0; k < size; k++)
        for (let row = 0, to = plane * size + k; row < rows; row++)
          for (let column = 0, sum = 0; column < columns; column++, to += planes * size)
            bytes[to] = sum = ((differences ? sum : 0) + raw[at++]) & 255;
    arrays[name] = size === 1 ? bytes : size === 2 ? new Uint16Array(bytes.buffer) : new Float32Array(bytes.buffer);
  }
  return arrays;
}

function shapeOf(name) { return meta.arrays.find((array) => array.name === name).shape; }

// ---- WebGL.

let gl, shade, show, area, framebuffer, isLinear;

function started() {
  gl = byId("picture").getContext("webgl2", { antialias: true });
  if (!gl) throw Error("This browser has no WebGL 2, which the page draws with.");
  if (!gl.getExtension("EXT_color_buffer_float")) throw Error("This device draws no floating-point pictures, which the page needs.");
  isLinear = Boolean(gl.getExtension("OES_texture_float_linear"));
  byId("picture").addEventListener("webglcontextlost", () => say("The graphics device was lost. Load the page again."));
}

function program(fragment) {
  const made = gl.createProgram();
  for (const [kind, id] of [[gl.VERTEX_SHADER, "plane"], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, byId(id).textContent.trim());
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.bindAttribLocation(made, 0, "corner");
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw Error(gl.getProgramInfoLog(made));
  const at = (name) => gl.getUniformLocation(made, name);
  return { made, at };
}

let nUnits = 0;

function texture(target, filter) {
  const most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
  const unit = nUnits++;
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(target, gl.createTexture());
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(target, name, filter);
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(target, name, gl.CLAMP_TO_EDGE);
  return { unit, most };
}

function picture(name, format, columns, rows, values, filter = gl.NEAREST) {
  const [inside, outside, kind] = format;
  const { unit, most } = texture(gl.TEXTURE_2D, filter);
  if (columns > most || rows > most) throw Error(`This device takes pictures of ${most} pixels a side, too few for this page; make it with a lower --resolution.`);
  gl.texImage2D(gl.TEXTURE_2D, 0, inside, columns, rows, 0, outside, kind, values);
  if (name) { gl.useProgram(shade.made); gl.uniform1i(shade.at(name), unit); }
  return unit;
}

// Entries stand in rows, the last one filled up.
function inRows(name, format, values, perEntry) {
  const columns = Math.min(gl.getParameter(gl.MAX_TEXTURE_SIZE), 4096);
  const rows = Math.max(Math.ceil(values.length / perEntry / columns), 1);
  const filled = new Uint16Array(rows * columns * perEntry);
  filled.set(values);
  picture(name, format, columns, rows, filled);
}

function startsAndCounts(counts) {
  const lists = new Uint32Array(2 * counts.length);
  for (let p = 0, start = 0; p < counts.length; start += counts[p++]) { lists[2 * p] = start; lists[2 * p + 1] = counts[p]; }
  return lists;
}

// Red's bits, and the differences of green's and blue's to them.
function fourChannels(weights) {
  const values = new Uint16Array((weights.length / 3) * 4);
  for (let i = 0, j = 0; i < weights.length; i += 3, j += 4) {
    values[j] = weights[i]; values[j + 1] = weights[i] + weights[i + 1]; values[j + 2] = weights[i] + weights[i + 2];
  }
  return values;
}

function fourOfThree(values) {
  const wide = new Float32Array((values.length / 3) * 4);
  for (let i = 0, j = 0; i < values.length; i += 3, j += 4) wide.set(values.subarray(i, i + 3), j);
  return wide;
}

// Five texels a column: its head, three of parameters, its colour with the unit of its weights.
function models({ header, parameters, scales }) {
  const n = scales.length, wide = new Float32Array(20 * Math.max(n, 1));
  for (let k = 0; k < n; k++) {
    wide.set(header.subarray(4 * k, 4 * k + 4), 20 * k);
    wide.set(parameters.subarray(12 * k, 12 * k + 12), 20 * k + 4);
    wide.set([...(meta.material_colours[k] || [0, 0, 0]), scales[k]], 20 * k + 16);
  }
  return [n, wide];
}

function upload(data) {
  const RG16 = [gl.RG16UI, gl.RG_INTEGER, gl.UNSIGNED_SHORT], R16 = [gl.R16UI, gl.RED_INTEGER, gl.UNSIGNED_SHORT];
  const RGB8 = [gl.RGB8UI, gl.RGB_INTEGER, gl.UNSIGNED_BYTE], RG32 = [gl.RG32UI, gl.RG_INTEGER, gl.UNSIGNED_INT];
  const HALF = [gl.RGBA16F, gl.RGBA, gl.HALF_FLOAT], FLOAT = [gl.RGBA32F, gl.RGBA, gl.FLOAT], ONE = [gl.R32F, gl.RED, gl.FLOAT];
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  picture("normals", RG16, width, height, data.normals);
  picture("heights", R16, width, height, data.heights);
  picture("facts", RGB8, width, height, data.facts);
  picture("lists", RG32, width, height, startsAndCounts(data.counts));
  inRows("columns", R16, data.columns, 1);
  inRows("weights", HALF, fourChannels(data.weights), 4);
  const [n, wide] = models(data);
  picture("models", FLOAT, 5, Math.max(n, 1), wide);
  const [nodeRows, nodeColumns] = shapeOf("nodes");
  picture("nodes", ONE, nodeColumns, nodeRows, data.nodes);
  const [tableRows, nHalf] = shapeOf("tables"), layers = nodeRows / 2;
  const { unit } = texture(gl.TEXTURE_2D_ARRAY, gl.NEAREST);
  gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RGBA32F, nHalf, tableRows / layers, layers, 0, gl.RGBA, gl.FLOAT, fourOfThree(data.tables));
  gl.uniform1i(shade.at("tables"), unit);
  area = picture(null, FLOAT, width, height, null, isLinear ? gl.LINEAR : gl.NEAREST);
  framebuffer = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, gl.getParameter(gl.TEXTURE_BINDING_2D), 0);
  gl.uniform2fv(shade.at("first_mm"), meta.first_mm);
  gl.uniform2fv(shade.at("heights_mm"), meta.heights_mm);
  gl.uniform1f(shade.at("spacing_mm"), meta.spacing_mm);
  gl.uniform1f(shade.at("albedo_angle"), meta.albedo_deg * DEGREE);
  gl.uniform1i(shade.at("n_materials"), meta.n_materials);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
}

const UNMOVED = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

// Shade every pixel of the area into the floating-point picture; camera and light in mm of the sample frame.
function shadeArea(camera, light, layer) {
  gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
  gl.viewport(0, 0, width, height);
  gl.useProgram(shade.made);
  gl.uniformMatrix4fv(shade.at("plane"), false, UNMOVED);
  gl.uniform3fv(shade.at("camera"), camera);
  gl.uniform3fv(shade.at("light"), light);
  gl.uniform1i(shade.at("layer"), LAYERS.indexOf(layer));
  gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
}

function shaded(light, camera = meta.camera, layer = "relit") {
  shadeArea(camera, light, layer);
  const values = new Float32Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, values);
  redraw();
  return values;
}

// ---- What is shown.

const cameraDistance = Math.hypot(...meta.camera);

function atFirst() {
  const distance = Math.hypot(...meta.light);
  return { layer: "relit", light_x: meta.light[0] / distance, light_y: meta.light[1] / distance, distance: distance / meta.extent_mm, tilt_x: 0, tilt_y: 0, exposure: 0 };
}

let state = atFirst();

// Rows of the rotation from the sample to the room, whose camera looks down the z axis.
function rotation() {
  const a = state.tilt_x * DEGREE, b = state.tilt_y * DEGREE;
  const [ca, sa, cb, sb] = [Math.cos(a), Math.sin(a), Math.cos(b), Math.sin(b)];
  return [[cb, sa * sb, ca * sb], [0, ca, -sa], [-sb, sa * cb, ca * cb]];
}

const turned = (R, v) => R.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);
const turnedBack = (R, v) => [0, 1, 2].map((j) => R[0][j] * v[0] + R[1][j] * v[1] + R[2][j] * v[2]);
const clamped = (x, low, high) => Math.min(Math.max(x, low), high);

function lightInRoom() {
  const z = Math.sqrt(Math.max(1 - state.light_x ** 2 - state.light_y ** 2, 0));
  return [state.light_x, state.light_y, z].map((x) => x * state.distance * meta.extent_mm);
}

function planeMatrix(R, aspect) {
  const half = [0.5 * width * meta.spacing_mm, 0.5 * height * meta.spacing_mm];
  const centre = [meta.first_mm[0] + 0.5 * (width - 1) * meta.spacing_mm, meta.first_mm[1] - 0.5 * (height - 1) * meta.spacing_mm, 0];
  const focal = cameraDistance / (1.12 * Math.max(half[1], half[0] / aspect));
  const projected = (v, w) => [focal * v[0] / aspect, focal * v[1], 0, w - v[2]];
  return [...projected(turned(R, [half[0], 0, 0]), 0), ...projected(turned(R, [0, half[1], 0]), 0), 0, 0, 1, 0, ...projected(turned(R, centre), cameraDistance)];
}

function draw() {
  const canvas = byId("picture"), R = rotation(), ratio = Math.min(window.devicePixelRatio || 1, 2);
  const w = Math.max(Math.round(canvas.clientWidth * ratio), 1), h = Math.max(Math.round(canvas.clientHeight * ratio), 1);
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  shadeArea(turnedBack(R, [0, 0, cameraDistance]), turnedBack(R, lightInRoom()), state.layer);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.viewport(0, 0, w, h);
  gl.clearColor(0.125, 0.129, 0.141, 1);
  gl.clear(gl.COLOR_BUFFER_BIT);
  gl.useProgram(show.made);
  gl.uniformMatrix4fv(show.at("plane"), false, planeMatrix(R, w / h));
  gl.uniform1i(show.at("area"), area);
  gl.uniform1f(show.at("gain"), gain());
  gl.uniform1i(show.at("is_colour"), state.layer === "relit" || state.layer === "albedo" ? 0 : 1);
  gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  tell();
}

function gain() {
  if (state.layer === "relit") return ((state.distance * meta.extent_mm) ** 2 / meta.white) * 2 ** state.exposure;
  return state.layer === "albedo" ? 2 ** state.exposure / meta.white_albedo : 1;
}

let isPending = false;

function redraw() {
  if (isPending) return;
  isPending = true;
  requestAnimationFrame(() => { isPending = false; draw(); });
}

// ---- What is told.

const RANGES = {
  light_x: (x) => x.toFixed(2), light_y: (x) => x.toFixed(2), distance: (x) => `${(x * meta.extent_mm).toFixed(0)} mm`,
  tilt_x: (x) => `${x.toFixed(0)}°`, tilt_y: (x) => `${x.toFixed(0)}°`, exposure: (x) => `${x < 0 ? "−" : "+"}${Math.abs(x).toFixed(1)} EV`,
};

function say(text) { byId("message").textContent = text; }

function tell() {
  for (const [name, text] of Object.entries(RANGES)) {
    byId(name).value = state[name];
    byId(name).setAttribute("aria-valuetext", text(state[name]));
    byId(`${name}_text`).textContent = text(state[name]);
  }
  byId("layer").value = state.layer;
  const canvas = byId("picture"), radius = 0.5 * Math.min(canvas.clientWidth, canvas.clientHeight);
  const lamp = byId("lamp").style;
  lamp.left = `${0.5 * canvas.clientWidth + radius * state.light_x}px`;
  lamp.top = `${0.5 * canvas.clientHeight - radius * state.light_y}px`;
  lamp.display = state.layer === "relit" ? "" : "none";
  const R = rotation(), normal = turned(R, [0, 0, 1]), light = lightInRoom(), distance = Math.hypot(...light);
  const toLight = Math.acos(clamped((light[0] * normal[0] + light[1] * normal[1] + light[2] * normal[2]) / distance, -1, 1)) / DEGREE;
  const toCamera = Math.acos(clamped(normal[2], -1, 1)) / DEGREE, thetaD = (0.5 * Math.acos(clamped(light[2] / distance, -1, 1))) / DEGREE;
  byId("caution").hidden = !(state.layer === "relit" && thetaD > 45);
  legend();
  later(`Light ${toLight.toFixed(0)}° and camera ${toCamera.toFixed(0)}° from the sample's normal; difference angle ${thetaD.toFixed(0)}°.`);
}

let timer = 0;

// Once the hand rests, so that a screen reader reads one sentence and not a hundred.
function later(text) {
  clearTimeout(timer);
  timer = setTimeout(() => { if (byId("state").textContent !== text) byId("state").textContent = text; }, 250);
}

let legendOf = "";

function legend() {
  if (legendOf === state.layer) return;
  legendOf = state.layer;
  const text = {
    relit: "", normals: "Red right, green up, blue out of the sample.", albedo: `π times the BRDF at ${meta.albedo_deg}° or as far as seen; white is ${meta.white_albedo.toPrecision(2)}.`,
    sigma: `White: ${meta.most_sigma_deg.toPrecision(2)}° or more per axis.`, height: `Black ${meta.heights_mm[0].toPrecision(3)} mm, white ${meta.heights_mm[1].toPrecision(3)} mm.`,
  };
  const place = byId("legend");
  place.textContent = text[state.layer] || "";
  if (state.layer !== "materials") return;
  const patch = (colour, name) => {
    const item = document.createElement("span"), swatch = document.createElement("i");
    swatch.style.background = `rgb(${colour.map((x) => Math.round(255 * x)).join(" ")})`;
    item.append(swatch, name);
    place.append(item);
  };
  meta.material_colours.forEach((colour, k) => patch(colour, `material ${k}`));
  patch([0.15, 0.15, 0.15], "atoms of its own");
}

// ---- What moves it.

function set(changes) {
  Object.assign(state, changes);
  const r = Math.hypot(state.light_x, state.light_y);
  if (r > 0.985) { state.light_x *= 0.985 / r; state.light_y *= 0.985 / r; }
  for (const name of ["tilt_x", "tilt_y"]) state[name] = clamped(state[name], -75, 75);
  state.exposure = clamped(state.exposure, -6, 6);
  redraw();
}

function lightAt(event) {
  const box = byId("picture").getBoundingClientRect(), radius = 0.5 * Math.min(box.width, box.height);
  set({ light_x: (event.clientX - box.left - 0.5 * box.width) / radius, light_y: (0.5 * box.height - event.clientY + box.top) / radius });
}

function listen() {
  const canvas = byId("picture"), pointers = new Map();
  let isTilting = false;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    canvas.focus({ preventScroll: true });
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    isTilting = event.shiftKey || event.button === 2 || pointers.size > 1;
    if (!isTilting) lightAt(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    // Of two fingers each gives half.
    const step = 0.4 / pointers.size;
    if (isTilting) set({ tilt_x: state.tilt_x + step * (event.clientY - before[1]), tilt_y: state.tilt_y + step * (event.clientX - before[0]) });
    else lightAt(event);
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("keydown", pressed);
  for (const name of Object.keys(RANGES)) byId(name).addEventListener("input", (event) => set({ [name]: Number(event.target.value) }));
  byId("layer").addEventListener("input", (event) => set({ layer: event.target.value }));
  byId("reset").addEventListener("click", () => set(atFirst()));
  new ResizeObserver(redraw).observe(canvas);
}

function pressed(event) {
  const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
  if (arrow && event.shiftKey) set({ tilt_x: state.tilt_x - 2 * arrow[1], tilt_y: state.tilt_y + 2 * arrow[0] });
  else if (arrow) set({ light_x: state.light_x + 0.03 * arrow[0], light_y: state.light_y + 0.03 * arrow[1] });
  else if (event.key === "+" || event.key === "=") set({ exposure: state.exposure + 0.25 });
  else if (event.key === "-") set({ exposure: state.exposure - 0.25 });
  else if (event.key === "Home") set(atFirst());
  else return;
  event.preventDefault();
}

// `page.html#layer=normals&tilt_x=20` opens it so; `#test=X,Y,Z,X,Y,Z` (camera, light) writes what is shaded into the page.
function asked() {
  const wishes = new URLSearchParams(location.hash.slice(1)), changes = {};
  for (const name of Object.keys(RANGES)) if (Number.isFinite(parseFloat(wishes.get(name)))) changes[name] = parseFloat(wishes.get(name));
  if ([...byId("layer").options].some((option) => option.value === wishes.get("layer"))) changes.layer = wishes.get("layer");
  set(changes);
  if (!wishes.has("test")) return;
  const [cx, cy, cz, lx, ly, lz] = wishes.get("test").split(",").map(Number);
  const values = shaded([lx, ly, lz], [cx, cy, cz], state.layer);
  const bytes = new Uint8Array(values.buffer);
  let text = "";
  for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
  byId("test").textContent = btoa(text);
}

(async () => {
  try {
    const data = await unpacked();
    started();
    shade = program("shade");
    show = program("show");
    upload(data);
    say("");
    listen();
    window.halfangle = { shade: shaded, set, meta };
    asked();
  } catch (error) {
    say(String(error.message || error));
    throw error;
  }
})();
