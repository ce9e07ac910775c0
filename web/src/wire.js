// The live picture as flat columns. A row is a slot: it belongs to one vessel until that vessel leaves.
// Frames of the subprotocols coastwatch.picture.v2 and v1 are read in place and written into the columns.

import { ahead, mercatorX, mercatorY } from './geodesy.js';

export const SUBPROTOCOLS = ['coastwatch.picture.v2', 'coastwatch.picture.v1']; // the newest first
export const SOG_UNKNOWN = 65535;
export const METRES_UNKNOWN = 255;
const MAGIC = 0x31505743; // "CWP1" read as little endian
const HEADER_BYTES = 48;
const FULL = 1;
const DELTA = 2;
const HEARTBEAT = 5;
const WORLD = 2 ** 32; // a turn of the Earth in units of `place`: 9 mm
/** Columns in the order of a frame. */
const COLUMNS = [
  ['lon', Int32Array], // 1e-7 degrees
  ['lat', Int32Array],
  ['sog', Uint16Array], // 0.01 knots
  ['cog', Uint16Array], // 360/65536 degrees
  ['kind', Uint8Array], // sum of 1 AIS, 2 radar, 4 bearing
  ['flag', Uint8Array],
  ['major', Uint8Array], // 2^(x/16)/2 metres
  ['minor', Uint8Array],
  ['angle', Uint8Array], // 180/256 degrees from north
  ['age', Uint8Array], // 2^(x/16) seconds, 0: under one
];

/** Columns behind them where a frame says so: the size of a vessel by radar. */
const ECHO_COLUMNS = [
  ['length', Uint8Array], // 2^(x/16)/2 metres
  ['width', Uint8Array],
  ['axis', Uint8Array], // 360/256 degrees from north
];
const HAS_ECHOES = 1;

/** A frame that is damaged, or that does not follow the picture that the page has. The page then asks for a full one. */
export class RefusedFrame extends Error {}

/** Half an axis of the 1-sigma ellipse in metres, from its byte; NaN where unknown. */
export const metresOf = (byte) => (byte === METRES_UNKNOWN ? NaN : 2 ** (byte / 16) / 2);
/** Seconds since a vessel was heard, from its byte. */
export const secondsOf = (byte) => (byte === 0 ? 0 : 2 ** (byte / 16));

export class Picture {
  slots = 0; // rows in use, free ones between them included
  vessels = 0;
  run = 0;
  seq = 0;
  at = 0; // Unix seconds of the newest frame
  epoch = 0; // Unix seconds from which `time` counts
  version = 0; // grows with every frame that changed something
  slotOf = new Map(); // vessel id to slot

  constructor() {
    this.#grow(1);
  }

  /** Makes room for more slots and keeps what is there. */
  #grow(slots) {
    if (this.id && this.id.length >= slots) return;
    const room = Math.ceil((slots * 1.25) / 1024) * 1024;
    const wider = (Type, old, width = 1) => {
      const made = new Type(room * width);
      if (old) made.set(old);
      return made;
    };
    this.id = wider(Uint32Array, this.id); // 0: the slot is free
    this.place = wider(Uint32Array, this.place, 2); // web mercator x, y
    this.time = wider(Float32Array, this.time); // seconds after `epoch` at which the position holds
    for (const [name, Type] of [...COLUMNS, ...ECHO_COLUMNS]) this[name] = wider(Type, this[name]);
  }

  /**
   * Takes one frame.
   * @param {ArrayBuffer} buffer one message of the socket
   * @returns {number} rows that it changed; -1 for a heartbeat
   * @throws {RefusedFrame} that says what was found and what was needed; the picture is as before
   */
  apply(buffer) {
    const head = readHeader(buffer);
    if (head.kind === HEARTBEAT) {
      if (head.run !== this.run) throw new RefusedFrame(`heartbeat: got run ${head.run}, needed ${this.run}`);
      return -1;
    }
    const full = head.kind === FULL;
    const afresh = full || head.base === 0; // a delta from nothing: the answer to a subscription
    if (!afresh && (head.run !== this.run || head.base !== this.seq)) {
      throw new RefusedFrame(
        `delta: got run ${head.run} and base ${head.base}, needed run ${this.run} and base ${this.seq}`,
      );
    }
    const rows = full ? head.slots : head.changed;
    const frame = full ? readFull(buffer, head) : readDelta(buffer, head);
    this.#grow(head.slots);
    if (afresh) this.#forget(head.time);
    if (full) {
      this.id.set(frame.id);
      for (let slot = 0; slot < rows; slot++) if (frame.id[slot]) this.slotOf.set(frame.id[slot], slot);
    } else {
      this.#leaveAndArrive(frame);
    }
    for (const [name] of COLUMNS) {
      const from = frame[name];
      const to = this[name];
      if (full) to.set(from);
      else for (let row = 0; row < rows; row++) to[frame.slot[row]] = from[row];
    }
    for (const [name] of ECHO_COLUMNS) {
      const from = frame[name];
      for (let row = 0; row < rows; row++) this[name][frame.slot ? frame.slot[row] : row] = from ? from[row] : METRES_UNKNOWN;
    }
    this.#locate(frame.slot, rows, head.time - this.epoch);
    Object.assign(this, { slots: head.slots, run: head.run, seq: head.seq, at: head.time });
    this.vessels = this.slotOf.size;
    this.version++;
    return rows;
  }

  /** Frees every slot. Args: time: Unix seconds from which times count from now on. */
  #forget(time) {
    this.epoch = time;
    this.slotOf.clear();
    for (const column of [this.id, this.kind, this.flag]) column.fill(0);
  }

  /** Frees the slots of vessels that left, then gives slots to those that came. */
  #leaveAndArrive({ removed, born, bornId }) {
    const leave = (slot) => this.slotOf.get(this.id[slot]) === slot && this.slotOf.delete(this.id[slot]);
    for (const slot of removed) {
      leave(slot);
      this.id[slot] = 0;
      this.kind[slot] = 0;
      this.flag[slot] = 0;
    }
    for (let row = 0; row < born.length; row++) {
      leave(born[row]); // where several frames were merged, a slot may change its vessel without being removed
      this.id[born[row]] = bornId[row];
      this.slotOf.set(bornId[row], born[row]);
    }
  }

  /** Mercator positions of changed rows. Args: slot: of each row; none: row k is slot k. */
  #locate(slot, rows, time) {
    const { lat, lon, place } = this;
    for (let row = 0; row < rows; row++) {
      const at = slot ? slot[row] : row;
      place[2 * at] = mercatorX(lon[at] / 1e7) * WORLD;
      place[2 * at + 1] = mercatorY(lat[at] / 1e7) * WORLD;
      this.time[at] = time;
    }
  }

  /** The vessel of a slot in the units of people. `seconds`: Unix time to which it is moved on. */
  vessel(slot, seconds = this.at) {
    const sog = this.sog[slot] === SOG_UNKNOWN ? NaN : this.sog[slot] / 100;
    const cog = (this.cog[slot] * 360) / 65536;
    const [lat, lon] = this.position(slot, seconds);
    return { id: this.id[slot], lat, lon, sog, cog, kind: this.kind[slot], flag: this.flag[slot] };
  }

  /** Length and width in metres and axis in degrees of a slot by radar, NaN where unknown; null: no length. */
  size(slot) {
    if (this.length[slot] === METRES_UNKNOWN || !this.id[slot]) return null;
    return { length: metresOf(this.length[slot]), width: metresOf(this.width[slot]), axis: (this.axis[slot] * 360) / 256 };
  }

  /** Latitude and longitude of a slot, moved on to a Unix time. */
  position(slot, seconds) {
    const sog = this.sog[slot] === SOG_UNKNOWN ? 0 : this.sog[slot] / 100;
    return ahead(this.lat[slot] / 1e7, this.lon[slot] / 1e7, sog, (this.cog[slot] * 360) / 65536, this.elapsed(slot, seconds));
  }

  /** Seconds since the position of a slot held: 0 to 600, so that a clock that is wrong throws nothing far away. */
  elapsed(slot, seconds) {
    return Math.min(600, Math.max(0, seconds - this.epoch - this.time[slot]));
  }
}

/** The header of a frame, refused where a field cannot be right. */
function readHeader(buffer) {
  if (buffer.byteLength < HEADER_BYTES) {
    throw new RefusedFrame(`frame: got ${buffer.byteLength} bytes, needed at least ${HEADER_BYTES}`);
  }
  const view = new DataView(buffer);
  const u32 = (at) => view.getUint32(at, true);
  const version = view.getUint8(4);
  if (u32(0) !== MAGIC || (version !== 1 && version !== 2)) {
    throw new RefusedFrame('frame: got another format or version, needed CWP1 version 1 or 2');
  }
  const head = {
    kind: view.getUint8(5), flags: view.getUint16(6, true), seq: u32(8), base: u32(12), time: view.getFloat64(16, true),
    slots: u32(24), changed: u32(28), removed: u32(32), born: u32(36), run: u32(40), bytes: u32(44),
  };
  if (head.bytes !== buffer.byteLength) {
    throw new RefusedFrame(`frame: got ${buffer.byteLength} bytes, needed ${head.bytes} as its header says`);
  }
  if (![FULL, DELTA, HEARTBEAT].includes(head.kind) || head.flags > (version === 2 ? HAS_ECHOES : 0)) {
    throw new RefusedFrame(`frame: got kind ${head.kind} with flags ${head.flags}, needed kind 1, 2 or 5 with flags 0`);
  }
  return head;
}

/** Reads columns one after the other; each begins on four bytes. */
function columnReader(buffer) {
  let offset = HEADER_BYTES;
  const take = (Type, count) => {
    const bytes = count * Type.BYTES_PER_ELEMENT;
    if (offset + bytes > buffer.byteLength) {
      throw new RefusedFrame(`frame: got ${buffer.byteLength} bytes, needed ${offset + bytes} for its columns`);
    }
    const column = new Type(buffer, offset, count);
    offset += Math.ceil(bytes / 4) * 4;
    return column;
  };
  return { take, end: () => offset };
}

/** The columns of a frame. Raises: RefusedFrame where bytes are left over. */
function readColumns(buffer, reader, rows, head) {
  const frame = {};
  const columns = head.flags & HAS_ECHOES ? [...COLUMNS, ...ECHO_COLUMNS] : COLUMNS;
  for (const [name, Type] of columns) frame[name] = reader.take(Type, rows);
  if (reader.end() !== buffer.byteLength) {
    throw new RefusedFrame(`frame: got ${buffer.byteLength} bytes, needed ${reader.end()} for its columns`);
  }
  return frame;
}

function readFull(buffer, head) {
  const reader = columnReader(buffer);
  const id = reader.take(Uint32Array, head.slots);
  return { id, ...readColumns(buffer, reader, head.slots, head) };
}

function readDelta(buffer, head) {
  const reader = columnReader(buffer);
  const slot = reader.take(Uint32Array, head.changed);
  const removed = reader.take(Uint32Array, head.removed);
  const born = reader.take(Uint32Array, head.born);
  const bornId = reader.take(Uint32Array, head.born);
  for (const column of [slot, removed, born]) {
    for (const at of column) {
      if (at >= head.slots) throw new RefusedFrame(`delta: got slot ${at}, needed less than ${head.slots}`);
    }
  }
  return { slot, removed, born, bornId, ...readColumns(buffer, reader, head.changed, head) };
}
