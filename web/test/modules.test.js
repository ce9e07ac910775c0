import assert from 'node:assert/strict';
import { test } from 'node:test';
import { closestApproach, mercatorX, mercatorY, rangeBearing, wrapped } from '../src/geodesy.js';
import { clock, course, dateClock, duration, length, position, seconds, shipClass, speed } from '../src/formats.js';
import { filterWords, listOrder, markShown, NO_FILTER } from '../src/filters.js';
import { defaults, fromQuery, toQuery } from '../src/state.js';
import { correctedPath, lastAis, lastsAt, trackRank } from '../src/panel.js';
import { restore, viewOf } from '../src/views.js';
import { contrast, FLAG, flagWords, luminance, NIGHT_LUMINANCE, STROKE_PX, SYMBOL, SYMBOL_COLOURS, symbolOf, THEMES } from '../src/symbols.js';
import { Picture } from '../src/wire.js';
import { full } from './frames.js';

test('mercator, range and bearing', () => {
  assert.equal(mercatorX(0), 0.5);
  assert.equal(mercatorY(0), 0.5);
  assert.ok(Math.abs(mercatorY(85.0511287798)) < 1e-9);
  assert.equal(wrapped(190), -170);
  const [range, bearing] = rangeBearing(0, 179.5, 0, -179.5);
  assert.ok(Math.abs(range - 111195) < 1 && Math.abs(bearing - 90) < 1e-9);
});

test('closest approach of two vessels that meet head on, and of two that draw apart', () => {
  const own = { lat: 50, lon: 0, sog: 10, cog: 0 };
  const meeting = closestApproach(own, { lat: 50.1, lon: 0, sog: 10, cog: 180 });
  assert.ok(Math.abs(meeting.time_s - 11112 / (20 * 1852 / 3600)) < 0.01 && meeting.distance_m < 1e-6);
  assert.ok(closestApproach(own, { lat: 50.1, lon: 0, sog: 20, cog: 0 }).time_s < 0);
  assert.equal(closestApproach(own, { ...own, lon: 0.01 }).time_s, 0);
});

test('numbers as people read them', () => {
  assert.equal(position(50.802, -1.105), "50°48.12'N 001°06.30'W");
  assert.equal(position(-22.9999999, 59.99999), "23°00.00'S 060°00.00'E");
  assert.deepEqual([speed(12.34), speed(NaN), speed(null)], ['12.3 kn', '–', '–']);
  assert.deepEqual([course(359.7), course(7)], ['000°', '007°']);
  assert.deepEqual([length(7.25), length(812), length(18520)], ['7.3 m', '812 m', '10.0 NM']);
  assert.deepEqual([duration(12), duration(185), duration(7500), duration(270000)], ['12 s', '3 min', '2 h 05 min', '3 d 03 h']);
  assert.equal(clock(seconds('2025-06-01T12:00:00.500Z')), '12:00:00');
  assert.equal(dateClock(0), '1970-01-01 00:00:00');
  assert.deepEqual([30, 37, 52, 61, 70, 88, 99, null].map(shipClass),
    ['fishing', 'pleasure', 'service', 'passenger', 'cargo', 'tanker', '', '']);
});

test('symbols by source; a vessel that no sensor has is lost', () => {
  assert.deepEqual([1, 2, 3, 4, 5, 6, 7].map((kind) => symbolOf(kind, 0)),
    [SYMBOL.ais, SYMBOL.radar, SYMBOL.fused, SYMBOL.bearing, SYMBOL.ais, SYMBOL.radar, SYMBOL.fused]);
  assert.equal(symbolOf(0, 0), SYMBOL.lost);
  assert.equal(symbolOf(1, FLAG.coasting), SYMBOL.lost);
  assert.deepEqual(flagWords(FLAG.dark | FLAG.alarm), ['alarm', 'dark']);
});

test('by day and dusk each symbol has a contrast of 3 to 1 against sea and land, and text of 4.5', () => {
  for (const name of ['day', 'dusk']) {
    for (const colour of SYMBOL_COLOURS) {
      for (const ground of ['sea', 'land']) {
        const found = contrast(THEMES[name][colour], THEMES[name][ground]);
        assert.ok(found >= 3, `${name}: ${colour} on ${ground} has ${found.toFixed(2)}`);
      }
    }
  }
  for (const [name, theme] of Object.entries(THEMES)) {
    for (const text of ['text', 'soft']) {
      for (const ground of ['panel', 'row']) {
        const found = contrast(theme[text], theme[ground]);
        assert.ok(found >= 4.5, `${name}: ${text} on ${ground} has ${found.toFixed(2)}`);
      }
    }
    assert.ok(contrast(theme.ongrave, theme.grave) >= 4.5, `${name}: text of distress has ${contrast(theme.ongrave, theme.grave).toFixed(2)}`);
    assert.ok(contrast(theme.warn, theme.panel) >= 3, `${name}: the edge of a trouble has ${contrast(theme.warn, theme.panel).toFixed(2)}`);
  }
});

test('by night nothing on the chart is brighter than the night table of S-52, and symbols are as bright as it allows', () => {
  for (const colour of [...SYMBOL_COLOURS, 'sea', 'land', 'shore', 'cover']) {
    assert.ok(luminance(THEMES.night[colour]) <= NIGHT_LUMINANCE + 1e-12, colour);
  }
  for (const colour of SYMBOL_COLOURS) assert.ok(luminance(THEMES.night[colour]) >= 0.95 * NIGHT_LUMINANCE, colour);
  assert.ok(STROKE_PX.night > STROKE_PX.day);
});

const fleet = () => {
  const picture = new Picture();
  picture.apply(full({ run: 1, seq: 1 }, [
    { id: 5, kind: 1, sog: 1000, age: 16 },
    { id: 6, kind: 2, sog: 65535, age: 64 },
    { id: 0 },
    { id: 7, kind: 3, sog: 200, flag: FLAG.dark },
    { id: 8, kind: 2, sog: 0, flag: FLAG.alarm },
  ]));
  return picture;
};
const details = new Map([[5, { name: 'Wight Sky', ship_type: 69, length_m: 62, mmsi: '235101063' }], [7, { name: 'ALBA', ship_type: 80 }]]);

test('filters hide vessels, but never one in distress', () => {
  const picture = fleet();
  const shown = new Uint8Array(picture.id.length);
  const ids = (filter) => {
    const count = markShown(picture, { ...NO_FILTER, ...filter }, details, shown);
    const found = [...picture.id].filter((_, slot) => shown[slot]);
    assert.equal(count, found.length);
    return found;
  };
  assert.deepEqual(ids({}), [5, 6, 7, 8]);
  assert.deepEqual(ids({ kinds: 1 }), [5, 7, 8]);
  assert.deepEqual(ids({ minSog: 5 }), [5, 8]);
  assert.deepEqual(ids({ maxSog: 5 }), [6, 7, 8]);
  assert.deepEqual(ids({ flagged: true }), [7, 8]);
  assert.deepEqual(ids({ type: 'tanker' }), [7, 8]);
  assert.deepEqual(ids({ minLength: 50 }), [5, 8]);
  assert.deepEqual(ids({ maxAge: 5 }), [5, 7, 8]);
  assert.deepEqual(filterWords({ ...NO_FILTER, kinds: 1, minSog: 5 }), ['sources: AIS', 'from 5 kn']);
  assert.deepEqual(filterWords(NO_FILTER), []);
});

test('the list sorts by any column, absent values last', () => {
  const picture = fleet();
  const shown = new Uint8Array(picture.id.length);
  markShown(picture, NO_FILTER, details, shown);
  const order = (column, down) => [...listOrder(picture, shown, details, { column, down })];
  assert.deepEqual(order('sog', false), [8, 7, 5, 6]);
  assert.deepEqual(order('sog', true), [5, 7, 8, 6]);
  assert.deepEqual(order('name', false), [7, 5, 6, 8]);
  assert.deepEqual(order('flags', true), [8, 7, 5, 6]);
});

test('a kept view has the chart, layers and filter, and neither the selection nor the replay', () => {
  const state = Object.assign(defaults(), { lat: 50.8, lon: -1.3, zoom: 9.25, theme: 'dusk', selected: 17, at: 1748779200 });
  state.filter.minSog = 2;
  state.layers.delete('cover');
  const later = Object.assign(defaults(), { selected: 4, drawer: 'alarms', lat: 1, lon: 2, zoom: 3 });
  restore(later, viewOf(state));
  assert.deepEqual(later, { ...state, selected: 4, at: null, drawer: 'alarms' });
});

test('the state goes into the address and comes back; nonsense keeps the defaults', () => {
  assert.equal(toQuery(defaults()), '');
  const state = defaults();
  Object.assign(state, { lat: 50.8, lon: -1.3, zoom: 9.25, theme: 'night', selected: 17, follow: true, drawer: 'vessels', at: 1748779200, speed: 30 });
  state.layers.delete('cover');
  Object.assign(state.filter, { kinds: 3, minSog: 2, type: 'cargo', maxAge: 60 });
  state.sort = { column: 'name', down: false };
  assert.deepEqual(fromQuery(toQuery(state)), state);
  assert.deepEqual(fromQuery('?lat=900&theme=pink&kinds=x&sort=-nothing&at=never&speed=7&vessel=-3&layers=labels,vectors,outlines,trail,cover,zones'), defaults());
});

test('the track that holds a vessel comes before ended ones and bearings, also in a replay', () => {
  const row = (kind, from, to) => ({ kind, from_utc: `2026-11-23T12:${from}:00Z`, to_utc: to && `2026-11-23T12:${to}:00Z` });
  const rows = [row('bearing', '50', '55'), row('bearing', '40', null), row('radar', '01', null), row('ais', '02', '30')];
  const at = (until) => rows.map((of) => trackRank(of, until));
  assert.deepEqual(at(Infinity), [3, 1, 0, 2]);
  assert.deepEqual(at(seconds('2026-11-23T12:20:00Z')).slice(2), [0, 0]); // its end was not known then
  assert.ok(!lastsAt('2026-11-23T12:50:00Z', null, seconds('2026-11-23T12:20:00Z')));
});

test('the ship as which a vessel sent AIS before, where the server says it', () => {
  const of = { last_ais_name: 'SALTY DOG', last_ais_mmsi: '710000001', last_ais_until_utc: '2026-11-24T12:03:04.000Z' };
  assert.equal(lastAis(of), 'SALTY DOG (710000001), until 12:03:04');
  assert.equal(lastAis({ ...of, last_ais_name: null, last_ais_until_utc: null }), '710000001');
  assert.equal(lastAis({ name: 'ALBA' }), '');
});

test('decided states take the place of what the watch saw then, and nothing else goes', () => {
  const seen = [{ at: 10, lat: 1, lon: 1 }, { at: 40, lat: 2, lon: 2 }, { at: 70, lat: 3, lon: 3 }, { at: 130, lat: 4, lon: 4 }];
  const decided = [{ at: 38, lat: 2.1, lon: 2.1 }, { at: 75, lat: 3.1, lon: 3.1 }];
  assert.deepEqual(correctedPath(seen, decided).map(({ at }) => at), [10, 38, 75, 130]);
  assert.deepEqual(correctedPath(seen, []), seen);
  assert.deepEqual(correctedPath([], decided), decided);
});
