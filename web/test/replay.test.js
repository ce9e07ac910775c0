import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Replay } from '../src/replay.js';

/** A replay of a page whose server answers each picture with this status. Returns: it, and what is said. */
function replayed(t, status) {
  const elements = {};
  const made = () => ({ addEventListener() {}, setAttribute() {} });
  t.mock.timers.enable({ apis: ['setInterval', 'setTimeout'] });
  globalThis.document = { activeElement: null, getElementById: (id) => (elements[id] ??= made()) };
  globalThis.fetch = async (path) => (path.includes('frame')
    ? { ok: false, status, json: async () => ({ detail: 'at: the first picture is of later' }) }
    : { ok: true, json: async () => ({ first_utc: '2026-11-24T12:00:00Z', last_utc: '2026-11-24T13:00:00Z', period_s: 3 }) });
  const said = [];
  const app = { live: { at: NaN }, state: { speed: 1 }, modeChanged() {}, forgetVessels() {}, pictureChanged() {}, stateChanged() {}, say: (words) => said.push(words) };
  return [new Replay(app), said];
}

test('a time that is not kept is said, and the picture is live again', async (t) => {
  const [replay, said] = replayed(t, 404);
  replay.enter(Date.parse('2020-01-01T00:00:00Z') / 1000);
  await new Promise(setImmediate);
  assert.deepEqual(said, ['Replay: at: the first picture is of later. The picture is live again.']);
  assert.equal(replay.at, null);
});

test('a replay whose server does not answer for a while stays where it is', async (t) => {
  const [replay, said] = replayed(t, 503);
  replay.enter(Date.parse('2026-11-24T12:30:00Z') / 1000);
  await new Promise(setImmediate);
  assert.deepEqual(said, ['Replay: at: the first picture is of later']);
  assert.notEqual(replay.at, null);
});
