// Which vessels the map and the list show, and in which order the list has them.

import { secondsOf, SOG_UNKNOWN } from './wire.js';
import { ALWAYS_SHOWN, gravity } from './symbols.js';
import { shipClass } from './formats.js';

/** Everything is shown. `kinds`: sum of 1 AIS, 2 radar, 4 bearing; speeds in knots; age in seconds; length in metres. */
export const NO_FILTER = Object.freeze({
  kinds: 7, flagged: false, type: '', minSog: 0, maxSog: Infinity, maxAge: Infinity, minLength: 0,
});

/** Words for each filter that is set, so that what is hidden is never a secret. */
export function filterWords(filter) {
  const sources = ['AIS', 'radar', 'bearing'].filter((_, bit) => filter.kinds & (1 << bit));
  return [
    filter.kinds !== 7 && `sources: ${sources.join(', ') || 'none'}`,
    filter.flagged && 'flagged only',
    filter.type && `type: ${filter.type}`,
    filter.minSog > 0 && `from ${filter.minSog} kn`,
    filter.maxSog < Infinity && `up to ${filter.maxSog} kn`,
    filter.maxAge < Infinity && `heard within ${filter.maxAge} s`,
    filter.minLength > 0 && `from ${filter.minLength} m`,
  ].filter(Boolean);
}

/** Whether a filter asks for details (type, length) that are not in the picture. */
export const needsDetails = (filter) => filter.type !== '' || filter.minLength > 0;

/**
 * Marks the slots that are shown.
 * @param {import('./wire.js').Picture} picture
 * @param {typeof NO_FILTER} filter
 * @param {Map<number, object>} details of vessels, by id; an unknown vessel fails a filter of type or length
 * @param {Uint8Array} shown one entry a slot: 1 shown, 0 hidden or free; written
 * @returns {number} how many are shown
 */
export function markShown(picture, filter, details, shown) {
  const { id, kind, flag, sog, age } = picture;
  const byDetails = needsDetails(filter);
  const minSog = filter.minSog * 100;
  const maxSog = filter.maxSog * 100;
  const oldest = filter.maxAge < Infinity ? Math.round(16 * Math.log2(Math.max(1, filter.maxAge))) : 255;
  let count = 0;
  for (let slot = 0; slot < picture.slots; slot++) {
    let show = id[slot] !== 0;
    if (show && !(flag[slot] & ALWAYS_SHOWN)) {
      const speed = sog[slot] === SOG_UNKNOWN ? 0 : sog[slot];
      show = (kind[slot] === 0 || (kind[slot] & filter.kinds) !== 0) && speed >= minSog && speed <= maxSog && age[slot] <= oldest
        && (!filter.flagged || flag[slot] !== 0) && (!byDetails || passesDetails(filter, details.get(id[slot])));
    }
    shown[slot] = show ? 1 : 0;
    count += shown[slot];
  }
  shown.fill(0, picture.slots);
  return count;
}

function passesDetails(filter, vessel) {
  if (!vessel) return false;
  if (filter.type && shipClass(vessel.ship_type) !== filter.type) return false;
  return !(filter.minLength > 0) || vessel.length_m >= filter.minLength;
}

/** Columns of the list: how each is compared. Absent values come last in either direction. */
const VALUE = {
  id: (p, slot) => p.id[slot],
  name: (p, slot, d) => d?.name?.toUpperCase() || undefined,
  mmsi: (p, slot, d) => d?.mmsi || undefined,
  type: (p, slot, d) => shipClass(d?.ship_type) || undefined,
  length: (p, slot, d) => d?.length_m ?? undefined,
  sog: (p, slot) => (p.sog[slot] === SOG_UNKNOWN ? undefined : p.sog[slot]),
  cog: (p, slot) => p.cog[slot],
  source: (p, slot) => p.kind[slot],
  flags: (p, slot) => gravity(p.flag[slot]),
  age: (p, slot) => secondsOf(p.age[slot]),
};
export const LIST_COLUMNS = Object.keys(VALUE);
/** Columns that need details of every vessel before they can be sorted. */
export const DETAIL_COLUMNS = ['name', 'mmsi', 'type', 'length'];

/**
 * Shown slots in the order of the list; equal ones by id.
 * @param {Uint8Array} shown as of markShown
 * @param {{column: string, down: boolean}} sort
 * @returns {Uint32Array} vessel ids, so that the order can be locked while slots change
 */
export function listOrder(picture, shown, details, { column, down }) {
  const rows = [];
  const value = VALUE[column];
  for (let slot = 0; slot < picture.slots; slot++) {
    if (shown[slot]) rows.push({ id: picture.id[slot], value: value(picture, slot, details.get(picture.id[slot])) });
  }
  const sign = down ? -1 : 1;
  rows.sort((a, b) => {
    if (a.value === b.value) return a.id - b.id;
    if (a.value === undefined) return 1;
    if (b.value === undefined) return -1;
    return a.value < b.value ? -sign : sign;
  });
  return Uint32Array.from(rows, (row) => row.id);
}
