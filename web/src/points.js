// Draws every vessel as one point of one draw call: the shader moves it on by course and speed and draws its symbol.
// It is a custom layer of MapLibre. Not instanced: software renderers run each instance as a draw of its own.

import { METRES_A_DEGREE, KNOT_M_S, mercatorX, mercatorY } from './geodesy.js';
import { ALWAYS_SHOWN, FLAG, RINGED, SYMBOL_COLOURS } from './symbols.js';

const VERTEX = `#version 300 es
layout(location=0) in uvec2 place; layout(location=1) in float time; layout(location=2) in uint sog; layout(location=3) in uint cog;
layout(location=4) in uint kind; layout(location=5) in uint flag; layout(location=6) in uint shown;
uniform uvec2 centre; uniform mat4 matrix; uniform float now; uniform float pixels; uniform float bright; uniform vec3 colours[8];
flat out vec3 colour; flat out vec3 ring; flat out vec2 heading; flat out float symbol; flat out float scale; flat out float small;
const float TURN = 6.28318530718;
void main() {
  if (shown == 0u) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); gl_PointSize = 1.0; return; }
  // Integers wrap at the date line and lose no digit: 9 mm anywhere.
  vec2 offset = vec2(ivec2(place - centre)) / 4294967296.0;
  float course = float(cog) * (TURN / 65536.0);
  float mercator = (float(place.y) / 4294967296.0 - 0.5) * TURN;
  float knots = sog == 65535u ? 0.0 : float(sog) * 0.01;
  float turns_s = knots * ${(KNOT_M_S / METRES_A_DEGREE / 360).toExponential(9)} * cosh(mercator);
  offset += vec2(sin(course), -cos(course)) * turns_s * clamp(now - time, 0.0, 600.0);
  gl_Position = vec4(matrix[0].xy * offset.x + matrix[1].xy * offset.y + matrix[3].xy, 0.0,
    matrix[0].w * offset.x + matrix[1].w * offset.y + matrix[3].w);
  bool lost = kind == 0u || (flag & ${FLAG.coasting}u) != 0u;
  symbol = lost ? 0.0 : (kind & 3u) != 0u ? float(kind & 3u) : 4.0;
  bool alarm = (flag & ${FLAG.alarm}u) != 0u, ringed = (flag & ${RINGED}u) != 0u;
  bool dim = shown == 2u && bright < 0.5;                     // 2: the ring of an alarm that nobody has acknowledged flashes
  colour = alarm ? colours[5] : colours[int(symbol)];
  ring = alarm ? colours[5] : colours[6];
  small = pixels < 5.0 ? 1.0 : 0.0;
  ringed = (ringed || alarm || shown == 2u) && !dim;
  scale = small > 0.5 ? 1.0 : ringed ? 1.55 : 1.0;
  gl_PointSize = small > 0.5 && ringed ? pixels + 2.0 : pixels * scale;
  if (small > 0.5 && ringed) colour = ring;
  heading = knots < 0.3 ? vec2(0.0, 1.0) : vec2(sin(course), cos(course));
  if (symbol == 1.0 && knots < 0.3) small = 0.5;              // a sleeping target
}`;

// Distances are in halves of the symbol's size; y is forward.
const FRAGMENT = `#version 300 es
precision highp float;
flat in vec3 colour; flat in vec3 ring; flat in vec2 heading; flat in float symbol; flat in float scale; flat in float small;
uniform float width; out vec4 paint;
float triangle(vec2 p) { return max(dot(vec2(abs(p.x), p.y - 0.95), vec2(0.9487, 0.3162)), -p.y - 0.78); }
void main() {
  if (small > 0.9) { paint = vec4(colour, 1.0); return; }
  vec2 p = (gl_PointCoord * 2.0 - 1.0) * vec2(scale, -scale);
  vec2 at = vec2(p.x * heading.y - p.y * heading.x, dot(p, heading));
  float stroke = width, far;
  if (small > 0.1) at /= 0.72;
  if (symbol < 0.5) far = max(min(abs(p.x - p.y), abs(p.x + p.y)) * 0.7071, length(p) - 0.85) - stroke;
  else if (symbol < 1.5) far = abs(triangle(at) + stroke) - stroke;
  else if (symbol < 2.5) far = abs(length(p) - 0.62) - stroke;
  else if (symbol < 3.5) far = triangle(at);
  else far = abs((abs(p.x) + abs(p.y) - 0.8) * 0.7071) - stroke;
  float soft = stroke * 0.8;
  float inside = 1.0 - smoothstep(-soft, soft, far);
  float about = scale > 1.2 ? 1.0 - smoothstep(-soft, soft, abs(length(p) - 1.3) - stroke) : 0.0;
  vec3 mixed = mix(colour, ring, about);
  float cover = max(inside, about);
  if (cover < 0.02) discard;
  paint = vec4(mixed * cover, cover);
}`;

const UNIFORMS = ['centre', 'matrix', 'now', 'pixels', 'bright', 'colours', 'width'];
const WORLD = 2 ** 32;

export class PointsLayer {
  id = 'vessels';
  type = 'custom';
  renderingMode = '2d';
  size = 3; // CSS pixels
  bright = true; // the half of a flash in which unacknowledged alarms are drawn
  shown = new Uint8Array(0); // one entry a slot: 0 hidden, 1 shown, 2 flashing
  shownVersion = 0;
  colours = new Float32Array(24);
  stroke = 1.5; // CSS pixels
  picture = null;

  /** @param {() => number} clock Unix seconds to which vessels are moved on */
  constructor(clock) {
    this.clock = clock;
  }

  /** Colours of a theme, in the order of SYMBOL_COLOURS. Args: stroke: width of lines in CSS pixels. */
  setTheme(theme, stroke) {
    this.stroke = stroke;
    SYMBOL_COLOURS.forEach((name, k) => this.colours.set(theme[name].map((value) => value / 255), 3 * k));
  }

  /** What is drawn from now on. Args: shown: of each slot; it is uploaded again at each call. */
  show(picture, shown) {
    this.picture = picture;
    this.shown = shown;
    this.shownVersion++;
  }

  onAdd(map, gl) {
    this.map = map;
    this.program = linked(gl, VERTEX, FRAGMENT);
    this.uniform = Object.fromEntries(UNIFORMS.map((name) => [name, gl.getUniformLocation(this.program, name)]));
    this.vertexArray = gl.createVertexArray();
    this.room = 0;
    this.uploaded = '';
  }

  onRemove(map, gl) {
    gl.deleteProgram(this.program);
    gl.deleteVertexArray(this.vertexArray);
    for (const buffer of this.buffers ?? []) gl.deleteBuffer(buffer);
    this.buffers = null;
  }

  /** Columns with the number of values a vessel and their type. */
  #columns(gl) {
    const p = this.picture;
    return [
      [p.place, 2, gl.UNSIGNED_INT],
      [p.time, 1, gl.FLOAT],
      [p.sog, 1, gl.UNSIGNED_SHORT],
      [p.cog, 1, gl.UNSIGNED_SHORT],
      [p.kind, 1, gl.UNSIGNED_BYTE],
      [p.flag, 1, gl.UNSIGNED_BYTE],
      [this.shown, 1, gl.UNSIGNED_BYTE],
    ];
  }

  /** Brings changed columns to the GPU. */
  #upload(gl) {
    const p = this.picture;
    const columns = this.#columns(gl);
    if (this.room !== p.id.length) {
      this.room = p.id.length;
      for (const buffer of this.buffers ?? []) gl.deleteBuffer(buffer);
      gl.bindVertexArray(this.vertexArray);
      this.buffers = columns.map(([values, width, type], location) => {
        const buffer = gl.createBuffer();
        gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
        gl.bufferData(gl.ARRAY_BUFFER, this.room * width * values.BYTES_PER_ELEMENT, gl.DYNAMIC_DRAW);
        gl.enableVertexAttribArray(location);
        if (type === gl.FLOAT) gl.vertexAttribPointer(location, width, type, false, 0, 0);
        else gl.vertexAttribIPointer(location, width, type, 0, 0);
        return buffer;
      });
      gl.bindVertexArray(null);
    }
    columns.forEach(([values, width], k) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[k]);
      gl.bufferSubData(gl.ARRAY_BUFFER, 0, values, 0, p.slots * width);
    });
  }

  render(gl, { defaultProjectionData: { mainMatrix } }) {
    const p = this.picture;
    if (!p || p.slots === 0 || this.shown.length !== p.id.length) return;
    const version = `${p.run} ${p.version} ${this.shownVersion}`;
    if (this.uploaded !== version) this.#upload(gl);
    this.uploaded = version;
    const { lng, lat } = this.map.getCenter();
    const x = mercatorX(lng);
    const y = mercatorY(lat);
    const near = Float32Array.from(mainMatrix); // moved to the centre in 64 bits, then rounded
    for (const row of [0, 1, 2, 3]) near[12 + row] = mainMatrix[row] * x + mainMatrix[4 + row] * y + mainMatrix[12 + row];
    const pixels = this.size * this.map.getPixelRatio();
    gl.useProgram(this.program);
    gl.bindVertexArray(this.vertexArray);
    gl.uniform2ui(this.uniform.centre, Math.round((((x % 1) + 1) % 1) * WORLD) >>> 0, Math.round(y * WORLD) >>> 0);
    gl.uniformMatrix4fv(this.uniform.matrix, false, near);
    gl.uniform1f(this.uniform.now, this.clock() - p.epoch);
    gl.uniform1f(this.uniform.pixels, Math.max(2, pixels));
    gl.uniform1f(this.uniform.width, Math.max(0.06 * this.stroke, this.stroke / Math.max(2, pixels)));
    gl.uniform1f(this.uniform.bright, this.bright ? 1 : 0);
    gl.uniform3fv(this.uniform.colours, this.colours);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.STENCIL_TEST);
    gl.disable(gl.CULL_FACE);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.drawArrays(gl.POINTS, 0, p.slots);
    gl.bindVertexArray(null);
  }

  /**
   * The shown slot drawn nearest to a point of the screen.
   * @param {{x: number, y: number}} point CSS pixels
   * @param {number} reach CSS pixels
   * @returns {number} -1 where none is within reach
   */
  pick({ x, y }, reach = 12) {
    const p = this.picture;
    if (!p) return -1;
    const { lng, lat } = this.map.unproject([x, y]);
    const px = (((mercatorX(lng) % 1) + 1) % 1) * WORLD;
    const py = mercatorY(lat) * WORLD;
    const unit = WORLD / (512 * 2 ** this.map.getZoom()); // of `place`, in a CSS pixel
    const fastest = 60 * KNOT_M_S * 600 * (WORLD / 40e6) * 4; // a vessel may be drawn this far from its last position
    const now = this.clock();
    let best = reach * unit;
    let found = -1;
    for (let slot = 0; slot < p.slots; slot++) {
      if (!this.shown[slot] || Math.abs(p.place[2 * slot + 1] - py) > best + fastest) continue;
      const [drawnLat, drawnLon] = p.position(slot, now);
      const dx = Math.abs(mercatorX(drawnLon) * WORLD - px);
      const apart = Math.hypot(Math.min(dx, WORLD - dx), mercatorY(drawnLat) * WORLD - py);
      const reached = p.flag[slot] & ALWAYS_SHOWN ? apart * 0.7 : apart; // where two overlap, the graver one
      if (reached < best) {
        best = reached;
        found = slot;
      }
    }
    return found;
  }
}

/** A linked program. Throws the log of the compiler. */
export function linked(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(`shader: ${gl.getShaderInfoLog(shader)}`);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(`program: ${gl.getProgramInfoLog(program)}`);
  return program;
}
