import assert from 'node:assert/strict';
import { test } from 'node:test';
import { AlarmBook, inDistress, ofVessel } from '../src/alarm_book.js';

const PRIORITY = { man_overboard: 0, sensor_silent: 1, close_approach: 2, dark: 3, odd_mmsi: 4 };

/** A row of the API. Args: at: seconds after noon. */
function alarm(vessel_id, kind, at, more = {}) {
  const start_utc = new Date(Date.UTC(2026, 10, 24, 12) + at * 1000).toISOString();
  return { alarm_id: `${vessel_id}-${kind}-${at}`, vessel_id, kind, priority: PRIORITY[kind], start_utc, end_utc: null, acknowledged_by: null, ...more };
}
const END = { end_utc: '2026-11-24T13:00:00.000Z' };
const ACKNOWLEDGED = { acknowledged_by: 'Ana' };

/** Vessels of the rows in order. Args: rows: as they come. */
function order(...rows) {
  const book = new AlarmBook();
  rows.forEach((row) => book.take(row));
  return book.rows().map(({ vessel_id }) => vessel_id);
}

test('distress comes first, then what nobody has acknowledged, then the newest; what is over comes last', () => {
  assert.deepEqual(order(
    alarm(1, 'odd_mmsi', 90), alarm(2, 'dark', 50), alarm(3, 'dark', 60), alarm(4, 'dark', 99, ACKNOWLEDGED), alarm(5, 'man_overboard', 1),
    alarm(6, 'man_overboard', 80, { ...END, ...ACKNOWLEDGED }), alarm(7, 'close_approach', 2, END), alarm(0, 'sensor_silent', 3),
    alarm(8, 'man_overboard', 95, ACKNOWLEDGED), alarm(9, 'dark', 55, END),
  ), [5, 8, 0, 7, 3, 9, 2, 4, 1, 6]);
});

test('an alarm that changes keeps its row', () => {
  const book = new AlarmBook();
  book.take(alarm(1, 'dark', 5));
  book.take(alarm(2, 'dark', 6));
  book.take(alarm(2, 'dark', 6, ACKNOWLEDGED));
  assert.deepEqual(book.rows().map(({ vessel_id, acknowledged_by }) => [vessel_id, acknowledged_by]), [[1, null], [2, 'Ana']]);
});

test('3,000 later alarms do not push a lasting one out, and only what is over is forgotten', () => {
  const book = new AlarmBook();
  book.take(alarm(1, 'dark', 0));
  for (let k = 0; k < 3000; k++) book.take(alarm(10 + k, 'dark', 1 + k));
  for (let k = 0; k < 3000; k++) book.take(alarm(5000 + k, 'dark', 1 + k, { ...END, ...ACKNOWLEDGED }));
  const rows = book.rows();
  assert.equal(rows.length, 3501);
  assert.equal(rows[3000].vessel_id, 1);
  assert.equal(rows[3001].vessel_id, 7999);
  assert.equal(book.get('5000-dark-1'), undefined);
});

test('an alarm of a sensor has no vessel, and one that was acknowledged is no distress to flash', () => {
  assert.deepEqual([0, -3, 4].map((vessel_id) => ofVessel({ vessel_id })), [false, false, true]);
  assert.ok(inDistress(alarm(4, 'man_overboard', 0)));
  assert.ok(!inDistress(alarm(4, 'man_overboard', 0, ACKNOWLEDGED)) && !inDistress(alarm(4, 'dark', 0)));
});
