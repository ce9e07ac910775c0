// What the page shows, as the query of its address: a link or a reload brings the same view back.

import { CLASSES } from './formats.js';
import { LIST_COLUMNS, NO_FILTER } from './filters.js';

export const LAYERS = ['labels', 'vectors', 'outlines', 'ellipses', 'trail', 'cover', 'zones', 'video'];
/** What the drawer on the left holds; empty: it is closed. */
export const DRAWERS = ['vessels', 'alarms', 'zones', 'layers'];
export const THEME_NAMES = ['day', 'dusk', 'night'];
export const VECTOR_MINUTES = [3, 6, 12, 30];
export const SPEEDS = [1, 2, 5, 10, 30, 60];

/** The state of a page opened without a query. `at`: Unix seconds of the replay, null: live. */
export function defaults() {
  return {
    lat: null, lon: null, zoom: null, theme: 'day', selected: 0, follow: false, drawer: '',
    layers: new Set(['labels', 'vectors', 'outlines', 'trail', 'cover', 'zones']), minutes: 6, filter: { ...NO_FILTER }, gain: 1, afterglow: 0,
    sort: { column: 'flags', down: true }, at: null, speed: 1,
  };
}

/** A number of the query within bounds, else what is given instead. */
function number(query, name, low, high, otherwise) {
  const value = Number(query.get(name));
  return query.has(name) && query.get(name) !== '' && value >= low && value <= high ? value : otherwise;
}

const choice = (value, allowed, otherwise) => (allowed.includes(value) ? value : otherwise);

/** Reads a query. What is not understood keeps its default: a link never breaks the page. */
export function fromQuery(text) {
  const query = new URLSearchParams(text);
  const state = defaults();
  const filter = state.filter;
  state.lat = number(query, 'lat', -85, 85, null);
  state.lon = number(query, 'lon', -180, 180, null);
  state.zoom = number(query, 'zoom', 1, 18, null);
  state.theme = choice(query.get('theme'), THEME_NAMES, state.theme);
  state.selected = Math.floor(number(query, 'vessel', 0, 2 ** 32 - 1, 0));
  state.follow = query.has('follow') && state.selected > 0;
  state.drawer = choice(query.get('drawer'), DRAWERS, '');
  if (query.has('layers')) state.layers = new Set(query.get('layers').split(',').filter((name) => LAYERS.includes(name)));
  state.minutes = choice(number(query, 'minutes', 1, 60, 6), VECTOR_MINUTES, 6);
  state.gain = number(query, 'gain', 0.5, 4, state.gain);
  state.afterglow = number(query, 'afterglow', 0, 0.9, state.afterglow);
  filter.kinds = Math.floor(number(query, 'kinds', 0, 7, 7));
  filter.flagged = query.has('flagged');
  filter.type = choice(query.get('type'), CLASSES, '');
  filter.minSog = number(query, 'minsog', 0, 655, 0);
  filter.maxSog = number(query, 'maxsog', 0, 655, Infinity);
  filter.maxAge = number(query, 'maxage', 0, 86400, Infinity);
  filter.minLength = number(query, 'minlength', 0, 600, 0);
  const sort = query.get('sort') ?? '';
  const column = sort.replace(/^-/, '');
  if (LIST_COLUMNS.includes(column)) state.sort = { column, down: sort.startsWith('-') };
  const at = Date.parse(query.get('at') ?? '') / 1000;
  if (!Number.isNaN(at)) state.at = at;
  state.speed = choice(number(query, 'speed', 1, 60, 1), SPEEDS, 1);
  return state;
}

/** Writes the query of a state: only what differs from the defaults. */
export function toQuery(state) {
  const query = new URLSearchParams();
  const plain = defaults();
  const put = (name, value, otherwise) => value !== otherwise && query.set(name, String(value));
  const filter = state.filter;
  if (state.lat !== null) {
    query.set('lat', state.lat.toFixed(4));
    query.set('lon', state.lon.toFixed(4));
    query.set('zoom', state.zoom.toFixed(2));
  }
  put('theme', state.theme, plain.theme);
  put('vessel', state.selected, 0);
  if (state.follow) query.set('follow', '1');
  put('drawer', state.drawer, '');
  const layers = (set) => LAYERS.filter((name) => set.has(name)).join(',');
  put('layers', layers(state.layers), layers(plain.layers));
  put('minutes', state.minutes, plain.minutes);
  put('gain', state.gain, plain.gain);
  put('afterglow', state.afterglow, plain.afterglow);
  put('kinds', filter.kinds, 7);
  if (filter.flagged) query.set('flagged', '1');
  put('type', filter.type, '');
  put('minsog', filter.minSog, 0);
  put('maxsog', filter.maxSog, Infinity);
  put('maxage', filter.maxAge, Infinity);
  put('minlength', filter.minLength, 0);
  put('sort', (state.sort.down ? '-' : '') + state.sort.column, '-flags');
  if (state.at !== null) query.set('at', new Date(state.at * 1000).toISOString().slice(0, 19) + 'Z');
  put('speed', state.speed, 1);
  return query.toString();
}
