// Radar video under the vessels: takes sectors of coastwatch.video.v1, keeps one texture a radar, and looks it up by range and azimuth.

import { byId } from './dom.js';
import { mercatorX, mercatorY, radii } from './geodesy.js';
import { follow } from './live.js';
import { linked } from './points.js';
import { RefusedFrame } from './wire.js';

const PROTOCOLS = ['coastwatch.video.v1'];
const MAGIC = 0x31565743; // "CWV1" read as little endian
const HEADER_BYTES = 64;
const SECTOR = 1;
const HEARTBEAT = 5;
export const SECTORS = 16;
export const AZIMUTHS = 64; // of a sector
export const RANGES = 512;
const SECTOR_CELLS = AZIMUTHS * RANGES;
const SHADE = 17; // of 255, a level
const HELLO = 0; // what `apply` returns for the greeting, and for a sector
const MOST_RADARS = 256; // that a viewer may ask for
const NO_RADARS = JSON.stringify({ radars: [] });
const STALE_MS = 15000; // a radar from which nothing has come for so long is not drawn
const OPACITY = 0.75; // of the strongest echo
const SOFTWARE_MS = 1000; // between drawings without a GPU

/** The newest turn of each radar. It is what `follow` keeps live. */
export class VideoPicture {
  run = 0;
  seq = 0;
  names = [];
  radars = new Map(); // index to {begun, cells, changed, lat, lon, range, time, at}
  afterglow = 0; // share of its strength that an echo keeps each turn
  done = Promise.resolve(); // once every sector so far is in its texture
  #cleared = 0; // how often: a sector that is inflated only after that is of a picture that is gone

  /** @param {() => void} told called when a sector is in its texture */
  constructor(told = () => {}) {
    this.told = told;
  }

  /**
   * Takes one message: the greeting, a heartbeat or a sector.
   * @param {string | ArrayBuffer} message
   * @returns {number} 0 for the greeting, -1 for a heartbeat, else the rows that change once it is inflated
   * @throws {RefusedFrame}
   */
  apply(message) {
    if (typeof message === 'string') {
      const { run, radars } = JSON.parse(message);
      if (run !== this.run) this.clear();
      Object.assign(this, { run, names: radars });
      return HELLO;
    }
    const view = new DataView(message);
    const fits = message.byteLength >= HEADER_BYTES && view.getUint32(0, true) === MAGIC && view.getUint8(4) === 1;
    if (!fits) throw new RefusedFrame(`video: got ${message.byteLength} bytes of another format, needed CWV1 version 1`);
    const head = {
      kind: view.getUint8(5), radar: view.getUint16(6, true), run: view.getUint32(8, true), seq: view.getUint32(12, true),
      begun: view.getUint32(16, true), place: view.getUint8(20), time: view.getFloat64(32, true), lat: view.getFloat64(40, true),
      lon: view.getFloat64(48, true), range: view.getFloat32(56, true),
    };
    const size = [view.getUint8(21), view.getUint16(22, true), view.getUint16(24, true)];
    if (head.run !== this.run || `${size}` !== `${[SECTORS, AZIMUTHS, RANGES]}` || head.place >= SECTORS) {
      throw new RefusedFrame(`video: got run ${head.run} with sectors of ${size}, needed run ${this.run} with ${SECTORS},${AZIMUTHS},${RANGES}`);
    }
    if (head.kind === HEARTBEAT) return -1;
    if (head.kind !== SECTOR) throw new RefusedFrame(`video: got kind ${head.kind}, needed 1 or 5`);
    this.seq = head.seq;
    // Several at a time, written in order. A damaged one has no octets: the next turn has it again.
    const inflated = inflate(new Uint8Array(message, HEADER_BYTES)).catch(() => new Uint8Array(0));
    const cleared = this.#cleared;
    this.done = this.done.then(async () => this.#put(head, await inflated, cleared));
    return AZIMUTHS;
  }

  clear() {
    this.seq = 0;
    this.#cleared += 1;
    this.radars.clear();
  }

  #put(head, octets, cleared) {
    if (cleared !== this.#cleared || octets.length !== SECTOR_CELLS / 2) return;
    let radar = this.radars.get(head.radar);
    if (radar?.begun !== head.begun) {
      radar = { begun: head.begun, cells: new Uint8Array(SECTORS * SECTOR_CELLS), changed: new Set() };
      this.radars.set(head.radar, radar);
    }
    const { lat, lon, range, time } = head;
    Object.assign(radar, { lat, lon, range, time, at: performance.now() });
    paintSector(radar.cells.subarray(head.place * SECTOR_CELLS), octets, this.afterglow);
    radar.changed.add(head.place);
    this.told();
  }
}

/** Writes a sector over the turn before. Args: cells: 0 to 255; octets: two levels each; afterglow: what is kept of the old cells. */
export function paintSector(cells, octets, afterglow) {
  for (let k = 0; k < octets.length; k++) {
    const near = (octets[k] >> 4) * SHADE;
    const far = (octets[k] & 15) * SHADE;
    cells[2 * k] = Math.max(near, cells[2 * k] * afterglow);
    cells[2 * k + 1] = Math.max(far, cells[2 * k + 1] * afterglow);
  }
}

/**
 * Names of the radars whose range meets the view, or whose place is not known.
 * @param {string[]} names those that send video
 * @param {object[]} sensors rows of /sensors
 * @param {{west: number, south: number, east: number, north: number}} view degrees; a world that is drawn twice is wider than 360
 */
export function radarsInView(names, sensors, { west, south, east, north }) {
  const [middle, half] = [(west + east) / 2, (east - west) / 2];
  return names.filter((name) => {
    const radar = sensors.find((sensor) => sensor.kind === 'radar' && sensor.name === name);
    if (!radar || radar.latitude_deg === null || !(radar.range_m > 0)) return true;
    const high = ((radar.range_m / radii(radar.latitude_deg).north) * 180) / Math.PI;
    const wide = high / Math.max(Math.cos((radar.latitude_deg * Math.PI) / 180), 1e-3);
    const apart = radar.longitude_deg - middle - 360 * Math.round((radar.longitude_deg - middle) / 360);
    return radar.latitude_deg + high >= south && radar.latitude_deg - high <= north && Math.abs(apart) <= half + wide;
  });
}

async function inflate(octets) {
  const stream = new Blob([octets]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// `offset` is on the mercator square, from the antenna.
const VERTEX = `#version 300 es
uniform mat4 matrix; uniform float reach; out vec2 offset;
void main() {
  offset = (vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0) * reach;
  gl_Position = vec4(matrix[0].xy * offset.x + matrix[1].xy * offset.y + matrix[3].xy, 0.0,
    matrix[0].w * offset.x + matrix[1].w * offset.y + matrix[3].w);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
in vec2 offset; uniform sampler2D cells; uniform float latitude; uniform vec2 radius; uniform vec3 colour; uniform float gain;
out vec4 paint;
const float TURN = 6.28318530718;
void main() {
  vec2 m = vec2(offset.x, -offset.y) * TURN;
  float north = cos(latitude) * (m.y - 0.5 * m.y * m.y * sin(latitude)); // of the latitude, to the second order
  vec2 at = vec2(m.x * cos(latitude + 0.5 * north), north) * radius;     // east and north in ranges of the radar
  float range = length(at);
  if (range >= 1.0) discard;
  float turn = fract(atan(at.x, at.y) / TURN);
  float strength = texelFetch(cells, ivec2(range * ${RANGES}.0, min(turn, 0.9999999) * ${SECTORS * AZIMUTHS}.0), 0).r;
  strength = min(strength * gain, 1.0) * ${OPACITY};
  if (strength == 0.0) discard;
  paint = vec4(colour * strength, strength);
}`;

/** Draws the newest turn of each radar below the vessels. */
export class VideoLayer {
  id = 'video';
  type = 'custom';
  renderingMode = '2d';
  shown = false;
  gain = 1;
  colour = new Float32Array(3);
  #textures = new Map(); // index of a radar to {texture, begun}

  /** @param {VideoPicture} picture */
  constructor(picture) {
    this.picture = picture;
  }

  onAdd(map, gl) {
    this.map = map;
    this.program = linked(gl, VERTEX, FRAGMENT);
    const names = ['matrix', 'reach', 'latitude', 'radius', 'colour', 'gain'];
    this.uniform = Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(this.program, name)]));
    this.vertexArray = gl.createVertexArray();
  }

  onRemove(map, gl) {
    gl.deleteProgram(this.program);
    gl.deleteVertexArray(this.vertexArray);
    for (const { texture } of this.#textures.values()) gl.deleteTexture(texture);
    this.#textures.clear();
  }

  /** Binds the texture of a radar with what has changed of it. */
  #bind(gl, index, radar) {
    let known = this.#textures.get(index);
    const fresh = known?.of !== radar || known.begun !== radar.begun; // numbers begin again with another run
    if (!known) {
      known = { texture: gl.createTexture() };
      this.#textures.set(index, known);
      gl.bindTexture(gl.TEXTURE_2D, known.texture);
      gl.texStorage2D(gl.TEXTURE_2D, 1, gl.R8, RANGES, SECTORS * AZIMUTHS);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    }
    gl.bindTexture(gl.TEXTURE_2D, known.texture);
    Object.assign(known, { of: radar, begun: radar.begun });
    for (const place of fresh ? Array(SECTORS).keys() : radar.changed) {
      const cells = radar.cells.subarray(place * SECTOR_CELLS, (place + 1) * SECTOR_CELLS);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, place * AZIMUTHS, RANGES, AZIMUTHS, gl.RED, gl.UNSIGNED_BYTE, cells);
    }
    radar.changed.clear();
  }

  render(gl, { defaultProjectionData: { mainMatrix } }) {
    if (!this.shown || !this.picture.radars.size) return;
    gl.useProgram(this.program);
    gl.bindVertexArray(this.vertexArray);
    gl.uniform3fv(this.uniform.colour, this.colour);
    gl.uniform1f(this.uniform.gain, this.gain);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.STENCIL_TEST);
    gl.disable(gl.CULL_FACE);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    const now = performance.now();
    const middle = mercatorX(this.map.getCenter().lng);
    for (const [index, radar] of this.picture.radars) {
      if (now - radar.at > STALE_MS) continue;
      this.#bind(gl, index, radar);
      const { east, north } = radii(radar.lat);
      const edge = Math.min(Math.abs((radar.lat * Math.PI) / 180) + radar.range / north, 1.5);
      const x = mercatorX(radar.lon) + Math.round(middle - mercatorX(radar.lon)); // the copy of the world in sight
      const y = mercatorY(radar.lat);
      const near = Float32Array.from(mainMatrix); // moved to the antenna in 64 bits, then rounded
      for (const row of [0, 1, 2, 3]) near[12 + row] = mainMatrix[row] * x + mainMatrix[4 + row] * y + mainMatrix[12 + row];
      gl.uniformMatrix4fv(this.uniform.matrix, false, near);
      gl.uniform1f(this.uniform.reach, (1.01 * radar.range) / (2 * Math.PI * north * Math.cos(edge)));
      gl.uniform1f(this.uniform.latitude, (radar.lat * Math.PI) / 180);
      gl.uniform2f(this.uniform.radius, east / radar.range, north / radar.range);
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    }
    gl.bindVertexArray(null);
  }
}

/** The video of the page: connected while its layer is on and the picture is live. */
export class Video {
  #link = null;
  #paintedAt = -Infinity;
  #state = ''; // of the socket
  #asked = null; // the text that asked for radars; empty: this connection has asked for none yet; null: it has not been greeted

  constructor(app) {
    this.app = app;
    this.picture = new VideoPicture(() => this.#changed());
    this.layer = new VideoLayer(this.picture);
  }

  /** Asks for the radars in view, where they are not those asked for before. */
  ask() {
    if (!this.#link || this.#asked === null) return;
    const bounds = this.app.map.getBounds();
    const view = { west: bounds.getWest(), south: bounds.getSouth(), east: bounds.getEast(), north: bounds.getNorth() };
    const radars = radarsInView(this.picture.names, this.app.sensors, view).slice(0, MOST_RADARS);
    const text = JSON.stringify({ radars });
    if (text === this.#asked) return;
    this.#asked = text;
    this.#link.send(text);
  }

  #changed() {
    const now = performance.now();
    if (this.app.software && now - this.#paintedAt < SOFTWARE_MS) return;
    this.#paintedAt = now;
    this.app.map.triggerRepaint();
  }

  /** Follows the state of the page: the layer, gain, afterglow, theme, live or replay. */
  update() {
    const { app, layer, picture } = this;
    const on = app.state.layers.has('video');
    if (on && app.replaying && layer.shown) app.say('A replay has no radar video.');
    layer.shown = on && !app.replaying;
    layer.gain = app.state.gain;
    layer.colour.set(app.theme().echo.map((value) => value / 255));
    picture.afterglow = app.state.afterglow;
    if (layer.shown && !this.#link) this.#open();
    if (!layer.shown && this.#link) {
      this.#link.stop();
      this.#link = this.#asked = null;
      picture.clear();
    }
    this.tell();
    app.map.triggerRepaint();
  }

  /** Another run has begun: a server that had no radar video may have some now. */
  runChanged() {
    if (this.#state === 'none') this.#link?.retry();
  }

  /** Says why nothing is drawn, where the layer is on. */
  tell() {
    const comes = [...this.picture.radars.values()].some(({ at }) => performance.now() - at <= STALE_MS);
    let words = '';
    if (this.app.state.layers.has('video')) {
      if (this.app.replaying) words = 'A replay has no radar video.';
      else if (this.#state === 'none') words = 'This server has no radar video: it does not run live, or has no radar.';
      else if (this.#asked === NO_RADARS && this.picture.names.length) words = 'No radar is in view.';
      else if (!comes) words = 'No radar video comes.';
    }
    if (byId('video-words').textContent !== words) byId('video-words').textContent = words;
  }

  #open() {
    this.#link = follow(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/api/v1/video/stream`, this.picture, {
      protocols: PROTOCOLS,
      frame: (changed) => {
        if (changed !== HELLO) return;
        this.#asked = '';
        this.ask();
      },
      state: (name) => {
        this.#state = name;
        if (name === 'none') this.tell();
      },
    });
  }
}
