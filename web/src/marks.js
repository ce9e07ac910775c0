// What is drawn over the points for vessels in view: course vectors, outlines, ellipses, trail, bearings, cover, labels, the selection.
// A canvas over the map, drawn again with each frame of the map. Each kind has a limit, so that a full coast stays quick.

import { KNOT_M_S, mercatorX, mercatorY, METRES_A_DEGREE, rangeBearing } from './geodesy.js';
import { course, label, miles } from './formats.js';
import { Names } from './names.js';
import { hull } from './outlines.js';
import { ALWAYS_SHOWN, css, FLAG, RINGED, STROKE_PX, SYMBOL_COLOURS, symbolOf } from './symbols.js';
import { METRES_UNKNOWN, metresOf, SOG_UNKNOWN } from './wire.js';

const MOST = { vectors: 5000, outlines: 2000, ellipses: 2000, labels: 120 };
const MARKS_FROM_ZOOM = 8;
const OUTLINE_PX = 20; // a shorter ship has its symbol alone
const LABELS_FROM_ZOOM = 9;
const NUMBERS_FROM_ZOOM = 12; // vessels without name and MMSI
const RAD = Math.PI / 180;
const WORLD = 2 ** 32;

export class Marks {
  #labels = [];
  #labelsAt = -Infinity;
  #names = new Names();
  #near = null; // see #nearby

  /** @param {HTMLCanvasElement} canvas over the map  @param {object} app the page */
  constructor(canvas, app) {
    this.canvas = canvas;
    this.app = app;
    this.context = canvas.getContext('2d');
  }

  /** Draws everything. Called after each frame of the map. */
  draw() {
    const { app, canvas } = this;
    const ratio = devicePixelRatio;
    const box = app.map.getContainer();
    const [width, height] = [box.clientWidth, box.clientHeight];
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.context.clearRect(0, 0, width, height);
    this.context.lineJoin = 'round';
    this.size = [width, height];
    this.colours = app.theme();
    this.line = STROKE_PX[app.state.theme] / STROKE_PX.day; // CSS pixels
    this.now = app.clock();
    const centre = app.map.getCenter();
    this.zoom = app.map.getZoom();
    this.origin = [mercatorX(centre.lng), mercatorY(centre.lat)];
    this.scale = 512 * 2 ** this.zoom; // CSS pixels of a turn of the Earth
    const { layers } = app.state;
    if (layers.has('cover')) this.#cover();
    this.#trail();
    this.#bearings();
    const detailed = this.zoom >= MARKS_FROM_ZOOM && ['vectors', 'outlines', 'ellipses', 'labels'].some((name) => layers.has(name));
    const seen = detailed ? this.#inView() : [];
    if (layers.has('outlines')) this.#outlines(seen.slice(0, MOST.outlines));
    if (layers.has('ellipses')) this.#ellipses(seen.slice(0, MOST.ellipses));
    if (layers.has('vectors')) this.#vectors(seen.slice(0, MOST.vectors));
    this.#selection();
    if (layers.has('labels')) this.#drawLabels(seen);
    this.#measure();
    if (app.awaitsPoint()) this.#centre();
  }

  /** A cross in the middle of the chart: the place that Enter takes. */
  #centre() {
    const { context } = this;
    const [x, y] = this.size.map((pixels) => pixels / 2);
    context.strokeStyle = css(this.colours.selected);
    context.lineWidth = this.line;
    context.beginPath();
    for (const [u, v] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      context.moveTo(x + 4 * u, y + 4 * v);
      context.lineTo(x + 14 * u, y + 14 * v);
    }
    context.stroke();
  }

  /** Screen position of a place in CSS pixels; nearest copy of the world. */
  screen(lat, lon) {
    let dx = mercatorX(lon) - this.origin[0];
    dx -= Math.round(dx);
    return [this.size[0] / 2 + dx * this.scale, this.size[1] / 2 + (mercatorY(lat) - this.origin[1]) * this.scale];
  }

  /** CSS pixels of a metre at a latitude. */
  pixels(lat) {
    return this.scale / (360 * METRES_A_DEGREE * Math.cos(lat * RAD));
  }

  /** Shown slots in view with their screen positions, at which the shader draws them too. */
  #inView() {
    const { picture } = this.app;
    const { place, lat, sog, cog } = picture;
    const unit = WORLD / this.scale; // of `place`, in a CSS pixel
    const beyond = 60 + 3000 * this.pixels(0); // a vessel is drawn ahead of its stored place
    const reach = this.size.map((pixels) => pixels / 2 + beyond);
    const centreX = Math.round((((this.origin[0] % 1) + 1) % 1) * WORLD) | 0;
    const centreY = Math.round(this.origin[1] * WORLD) | 0;
    const found = [];
    for (const slot of this.#nearby(centreX, centreY, reach.map((pixels) => pixels * unit))) {
      const dx = ((place[2 * slot] - centreX) | 0) / unit;
      const dy = ((place[2 * slot + 1] - centreY) | 0) / unit;
      if (dx > reach[0] || dx < -reach[0] || dy > reach[1] || dy < -reach[1]) continue;
      const latitude = lat[slot] / 1e7;
      const knots = sog[slot] === SOG_UNKNOWN ? 0 : sog[slot] / 100;
      const way = knots * KNOT_M_S * picture.elapsed(slot, this.now) * this.pixels(latitude); // CSS pixels
      const course = (cog[slot] * 2 * Math.PI) / 65536;
      const x = this.size[0] / 2 + dx + way * Math.sin(course);
      found.push({ slot, lat: latitude, x, y: this.size[1] / 2 + dy - way * Math.cos(course) });
    }
    return found;
  }

  /**
   * Shown slots within twice a reach of the centre, in units of `place`. They are looked for again with another picture, filter or
   * zoom, and once the centre has moved by more than the reach: a loop over all vessels takes most of a frame.
   * Differences are in whole numbers, which wrap at the date line.
   */
  #nearby(centreX, centreY, [reachX, reachY]) {
    const { picture, shown, points } = this.app;
    const of = [picture, picture.run, picture.version, points.shownVersion, this.zoom, ...this.size];
    const near = this.#near;
    if (near && of.every((value, k) => value === near.of[k]) && Math.abs((near.centreX - centreX) | 0) <= reachX
      && Math.abs((near.centreY - centreY) | 0) <= reachY) return near.slots;
    const { place } = picture;
    const [farX, farY] = [Math.min(2 ** 31 - 1, 2 * reachX), Math.min(2 ** 31 - 1, 2 * reachY)];
    const slots = [];
    for (let slot = 0; slot < picture.slots; slot++) {
      if (!shown[slot]) continue;
      const dx = (place[2 * slot] - centreX) | 0;
      const dy = (place[2 * slot + 1] - centreY) | 0;
      if (dx <= farX && dx >= -farX && dy <= farY && dy >= -farY) slots.push(slot);
    }
    this.#near = { of, centreX, centreY, slots };
    return slots;
  }

  /** Colour of a vessel, as its place in SYMBOL_COLOURS. */
  #colourOf(slot) {
    const { flag, kind } = this.app.picture;
    return flag[slot] & FLAG.alarm ? SYMBOL_COLOURS.indexOf('alarm') : symbolOf(kind[slot], flag[slot]);
  }

  /** Where each vessel is after the minutes of the layer, with a tick a minute, three minutes from 12 on. One path a colour. */
  #vectors(seen) {
    const { app, context } = this;
    const { picture } = app;
    const { minutes } = app.state;
    const step = minutes > 6 ? 3 : 1;
    const lines = Array.from({ length: 2 * SYMBOL_COLOURS.length }, () => []); // by colour and dashes: x, y of two ends of each line
    for (const { slot, x, y, lat } of seen) {
      const sog = picture.sog[slot];
      if (sog === SOG_UNKNOWN || sog < 50) continue;
      const way = (sog / 100) * KNOT_M_S * 60 * this.pixels(lat); // of a minute, CSS pixels
      const angle = (picture.cog[slot] * 2 * Math.PI) / 65536;
      const u = Math.sin(angle);
      const v = -Math.cos(angle);
      const ends = lines[2 * this.#colourOf(slot) + (picture.kind[slot] === 1 ? 1 : 0)]; // dashed: AIS alone
      const start = Math.min(8, way * minutes);
      ends.push(x + u * start, y + v * start, x + u * way * minutes, y + v * way * minutes);
      if (way * step <= 7) continue;
      for (let minute = step; minute < minutes; minute += step) {
        const a = x + u * way * minute;
        const b = y + v * way * minute;
        ends.push(a + v * 3, b - u * 3, a - v * 3, b + u * 3);
      }
    }
    context.lineWidth = this.line;
    for (const [style, ends] of lines.entries()) {
      if (!ends.length) continue;
      context.strokeStyle = css(this.colours[SYMBOL_COLOURS[style >> 1]], 0.85);
      context.setLineDash(style & 1 ? [4, 3] : []);
      context.beginPath();
      for (let k = 0; k < ends.length; k += 4) {
        context.moveTo(ends[k], ends[k + 1]);
        context.lineTo(ends[k + 2], ends[k + 3]);
      }
      context.stroke();
    }
    context.setLineDash([]);
  }

  /** Hulls true to scale, of ships whose size radar sees. */
  #outlines(seen) {
    const { picture } = this.app;
    const { context } = this;
    context.lineWidth = 1.5 * this.line;
    for (const { slot, x, y, lat } of seen) {
      const size = picture.size(slot);
      const unit = this.pixels(lat);
      if (!size || size.length * unit < OUTLINE_PX) continue;
      const knots = picture.sog[slot] === SOG_UNKNOWN ? NaN : picture.sog[slot] / 100;
      context.beginPath();
      for (const [east, north] of hull(size, knots)) context.lineTo(x + east * unit, y - north * unit);
      context.closePath();
      context.strokeStyle = css(this.colours[SYMBOL_COLOURS[this.#colourOf(slot)]]);
      context.stroke();
    }
  }

  /** 2-sigma ellipses of the position. */
  #ellipses(seen) {
    this.context.lineWidth = this.line;
    for (const { slot, x, y, lat } of seen) this.#ellipse(slot, x, y, lat, 0.6);
  }

  #ellipse(slot, x, y, lat, opacity) {
    const { picture } = this.app;
    if (picture.major[slot] === METRES_UNKNOWN || picture.minor[slot] === METRES_UNKNOWN) return;
    const unit = 2 * this.pixels(lat);
    const [major, minor] = [metresOf(picture.major[slot]) * unit, metresOf(picture.minor[slot]) * unit];
    if (major < 3) return;
    const angle = (picture.angle[slot] * Math.PI) / 256;
    this.context.beginPath();
    this.context.ellipse(x, y, major, minor, angle - Math.PI / 2, 0, 2 * Math.PI);
    this.context.strokeStyle = css(this.colours[SYMBOL_COLOURS[this.#colourOf(slot)]], opacity);
    this.context.stroke();
  }

  /** The path of the selected vessel up to the drawn time. */
  #trail() {
    const { app, context } = this;
    const trail = app.state.layers.has('trail') ? app.trail() : [];
    if (trail.length < 2) return;
    context.beginPath();
    trail.forEach(({ lat, lon }, k) => {
      const [x, y] = this.screen(lat, lon);
      if (k) context.lineTo(x, y);
      else context.moveTo(x, y);
    });
    const slot = app.selectedSlot();
    if (slot >= 0) context.lineTo(...this.screen(...app.picture.position(slot, this.now)));
    context.strokeStyle = css(this.colours.selected, 0.7);
    context.lineWidth = 1.5 * this.line;
    context.stroke();
  }

  /** Lines of sight that were given to the selected vessel. */
  #bearings() {
    const { context } = this;
    context.strokeStyle = css(this.colours.bearing, 0.9);
    context.lineWidth = this.line;
    for (const { lat, lon, bearing_deg, range_m } of this.app.bearings()) {
      const [x, y] = this.screen(lat, lon);
      const far = range_m * this.pixels(lat);
      context.beginPath();
      context.moveTo(x, y);
      context.lineTo(x + far * Math.sin(bearing_deg * RAD), y - far * Math.cos(bearing_deg * RAD));
      context.stroke();
    }
  }

  /** Ranges of the sensors. */
  #cover() {
    const { context } = this;
    context.strokeStyle = css(this.colours.cover, 0.8);
    context.fillStyle = css(this.colours.lost);
    context.lineWidth = this.line;
    context.font = '11px system-ui, sans-serif';
    for (const sensor of this.app.sensors) {
      if (sensor.latitude_deg === null || !(sensor.range_m > 0)) continue;
      const [x, y] = this.screen(sensor.latitude_deg, sensor.longitude_deg);
      const radius = sensor.range_m * this.pixels(sensor.latitude_deg);
      if (radius < 4 || radius > 20000) continue;
      context.setLineDash(sensor.kind === 'radar' ? [] : [2, 5]);
      context.beginPath();
      context.arc(x, y, radius, 0, 2 * Math.PI);
      context.stroke();
      context.setLineDash([]);
      context.strokeRect(x - 3, y - 3, 6, 6);
      if (this.zoom >= MARKS_FROM_ZOOM && sensor.name) context.fillText(sensor.name, x + 7, y - 5);
    }
  }

  /** Corners about the selected vessel, and about the second one, with its ellipse. */
  #selection() {
    const { app, context } = this;
    for (const [slot, half] of [[app.selectedSlot(), 13], [app.secondSlot(), 10]]) {
      if (slot < 0) continue;
      const [lat, lon] = app.picture.position(slot, this.now);
      const [x, y] = this.screen(lat, lon);
      context.strokeStyle = css(this.colours.selected);
      context.lineWidth = 2 * this.line;
      context.beginPath();
      for (const [a, b] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) {
        context.moveTo(x + a * half, y + b * (half - 6));
        context.lineTo(x + a * half, y + b * half);
        context.lineTo(x + a * (half - 6), y + b * half);
      }
      context.stroke();
      context.lineWidth = this.line;
      this.#ellipse(slot, x, y, lat, 0.9);
    }
  }

  /** Names, the graver and larger vessels first, where there is room. Which ones: chosen again each half second. */
  #drawLabels(seen) {
    const { app, context } = this;
    if (performance.now() - this.#labelsAt > 500) {
      this.#labelsAt = performance.now();
      this.#labels = this.#chosen(seen).map(({ slot }) => app.picture.id[slot]);
      app.details.need(this.#labels);
    }
    const [width, height] = this.size;
    const night = app.state.theme === 'night'; // dark and bold, as texts beside the chart are too bright for it
    const [colour, halo] = [css(night ? this.colours.fused : this.colours.text), css(this.colours.sea, 0.75)];
    const taken = [];
    for (const id of this.#labels) {
      const slot = app.picture.slotOf.get(id);
      if (slot === undefined || !app.details.has(id)) continue; // it left, or its name is on the way
      const [x, y] = this.screen(...app.picture.position(slot, this.now));
      if (x < 0 || y < 0 || x > width || y > height) continue;
      const text = label(id, app.details.get(id));
      const [left, top] = [x + 13, y - 8];
      const drawn = this.#names.of(text, colour, halo, night);
      const right = left + drawn.width;
      if (taken.some((box) => left < box[2] && right > box[0] && top < box[3] && top + 14 > box[1])) continue;
      taken.push([left, top, right, top + 14]);
      this.#names.draw(context, drawn, left, top);
    }
  }

  #chosen(seen) {
    const { app } = this;
    const { picture, details } = app;
    const crowded = this.zoom < LABELS_FROM_ZOOM;
    const weight = ({ slot }) => {
      const id = picture.id[slot];
      if (id === app.state.selected) return 1e7;
      const flagged = (picture.flag[slot] & ALWAYS_SHOWN ? 1e6 : 0) + (picture.flag[slot] & RINGED ? 1e5 : 0);
      if (crowded && !flagged) return -1;
      const named = details.get(id)?.name || details.get(id)?.mmsi || !details.has(id);
      if (!flagged && !named && this.zoom < NUMBERS_FROM_ZOOM) return -1;
      const speed = picture.sog[slot] === SOG_UNKNOWN ? 0 : picture.sog[slot] / 100;
      return flagged + (details.get(id)?.length_m ?? 0) + speed;
    };
    return seen.map((vessel) => ({ slot: vessel.slot, weight: weight(vessel) })).filter((vessel) => vessel.weight >= 0)
      .sort((a, b) => b.weight - a.weight || a.slot - b.slot).slice(0, MOST.labels);
  }

  /** Range and bearing from the selected vessel, or from the first click, to the pointer. */
  #measure() {
    const { app, context } = this;
    if (!app.measure?.from || !app.measure.to) return;
    const { from, to } = app.measure;
    const [x, y] = this.screen(from.lat, from.lon);
    const [u, v] = this.screen(to.lat, to.lon);
    context.strokeStyle = css(this.colours.selected);
    context.lineWidth = 1.5 * this.line;
    context.setLineDash([6, 4]);
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(u, v);
    context.stroke();
    context.setLineDash([]);
    const [range, bearing] = rangeBearing(from.lat, from.lon, to.lat, to.lon);
    context.font = 'bold 13px system-ui, sans-serif';
    context.lineWidth = 4;
    context.strokeStyle = css(this.colours.sea, 0.85);
    const text = `${miles(range)}  ${course(bearing)}`;
    context.strokeText(text, u + 12, v - 8);
    context.fillStyle = css(this.colours.selected);
    context.fillText(text, u + 12, v - 8);
  }
}
