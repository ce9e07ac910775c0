import assert from 'node:assert/strict';
import { test } from 'node:test';
import { badgeOf, sinceWords, troublesOf, troubleWords } from '../src/health.js';

const GOOD = {
  status: { live: true, run_status: 'running', period_s: 3, age_s: 3.2, late_s: 0.2, server_utc: '2026-11-24T12:03:30.000Z', error: null, troubles: [] },
  statusError: '', statusAge_s: 1, socket: 'open', waited_s: 1, replaying: false, sensors: [], alarmsError: '',
};
const trouble = (kind, serious, text, more = {}) => ({ kind, name: '', since_utc: null, text, serious, ...more });
const sensor = (kind, health) => ({ kind, name: `the ${kind}`, health, heard_utc: health === 'silent' ? '2026-11-24T12:01:00.000Z' : null });

/** What the page shows. Args: change: to a server where all is well; of_status: to its status. */
function shown(change = {}, of_status = {}) {
  const known = { ...GOOD, ...change, status: 'status' in change ? change.status : { ...GOOD.status, ...of_status } };
  const troubles = troublesOf(known);
  return [badgeOf(known, troubles), troubles.map(troubleWords), troubles];
}

test('where all is well the badge is green and nothing is listed', () => {
  assert.deepEqual(shown().slice(0, 2), [{ is: 'live', words: 'LIVE  lag 3 s' }, []]);
});

test('no feed is heard: the badge says for how long, the serious comes first', () => {
  const since = '2026-11-24T12:01:00.000Z';
  const troubles = [trouble('feed', false, 'nothing has come for 150 s', { name: 'north' }), trouble('feed', true, 'no feed has been heard for 150 s', { since_utc: since })];
  const [badge, lines, [first]] = shown({}, { troubles });
  assert.deepEqual(badge, { is: 'late', words: 'NO FEED  3 min' });
  assert.deepEqual(lines, ['Feed: no feed has been heard for 150 s', 'Feed north: nothing has come for 150 s']);
  assert.equal(sinceWords(first, Date.parse(since) / 1000 + 150), 'since 12:01:00');
  assert.equal(sinceWords(first, Date.parse(since) / 1000 + 90000), 'since 2026-11-24 12:01:00');
});

test('a database that is not written, a clock that was set and merged cycles are said, and the badge is not green', () => {
  const troubles = [trouble('store', false, 'the database cannot be written: disk full'), trouble('clock', false, 'the clock of this machine was set by +3600 s'),
    trouble('behind', false, '5 cycles of the last 10 minutes were merged')];
  const [badge, lines] = shown({}, { troubles });
  assert.deepEqual(badge, { is: 'degraded', words: 'LIVE  lag 3 s  3 TROUBLES' });
  assert.deepEqual(lines, ['Database: the database cannot be written: disk full', 'Clock: the clock of this machine was set by +3600 s',
    'Late: 5 cycles of the last 10 minutes were merged']);
  assert.deepEqual(shown({}, { late_s: 23, troubles: [trouble('behind', true, 'cycles take too long')] })[0], { is: 'late', words: 'LATE  23 s' });
  assert.deepEqual(shown({}, { age_s: 41, troubles: [trouble('picture', true, 'no picture has come')] })[0], { is: 'late', words: 'LATE  41 s' });
});

test('a run that has failed, ended or died is never green', () => {
  const of = (error) => shown({}, { error, run_status: 'failed' });
  assert.deepEqual(of('the run has failed: disk I/O error').slice(0, 2), [{ is: 'late', words: 'RUN FAILED' }, ['Run: the run has failed: disk I/O error']]);
  assert.equal(of('the run has ended: its input has no more reports')[0].words, 'RUN ENDED');
  assert.deepEqual(of('waiting for the first cycle')[0], { is: 'late', words: 'NO NEW PICTURE' });
  assert.deepEqual(shown({}, { live: false, run_status: 'died' }).slice(0, 2),
    [{ is: 'late', words: 'STORED  RUN DIED' }, ['Run: the run has died: its process is gone']]);
  assert.deepEqual(shown({}, { live: false, run_status: 'finished' })[0], { is: 'stored', words: 'STORED' });
});

test('sensors that are silent are listed while the run lasts; a sonar that hears no ship is not', () => {
  const sensors = [sensor('radar', 'silent'), sensor('ais', 'never heard'), sensor('bearing', 'silent'), sensor('radar', 'heard')];
  const [badge, lines] = shown({ sensors });
  assert.deepEqual(badge, { is: 'degraded', words: 'LIVE  lag 3 s  2 TROUBLES' });
  assert.deepEqual(lines, ['Sensor the radar: this radar is silent', 'Sensor the ais: this AIS receiver has not been heard yet']);
  assert.deepEqual(shown({ sensors }, { live: false, run_status: 'finished' })[1], []);
  assert.equal(shown({ sensors }, { live: false, run_status: 'running' })[1].length, 2);
});

test('connections of the page itself: socket, status and alarms', () => {
  assert.deepEqual(shown({ socket: 'lost', waited_s: 12 }).slice(0, 2), [{ is: 'late', words: 'NO CONNECTION  12 s' }, ['Connection: no picture has come for 12 s']]);
  assert.deepEqual(shown({ socket: 'waiting', waited_s: Infinity, status: null, statusError: 'waiting for the first cycle', statusAge_s: Infinity }).slice(0, 2),
    [{ is: 'late', words: 'NO PICTURE YET' }, ['Server: waiting for the first cycle']]);
  assert.deepEqual(shown({ waited_s: 8 })[0], { is: 'late', words: 'LATE  8 s' });
  assert.deepEqual(shown({ statusError: 'the database is away', statusAge_s: 60 }).slice(0, 2),
    [{ is: 'degraded', words: 'LIVE  lag 3 s  1 TROUBLE' }, ['Server: the database is away']]);
  assert.deepEqual(shown({ statusError: 'the server does not answer', statusAge_s: 4 })[1], []); // one answer was lost
  assert.deepEqual(shown({ alarmsError: 'the server does not answer' })[1], ['Alarms: not up to date: the server does not answer']);
  assert.equal(shown({ replaying: true }, { error: 'the run has failed: x' })[0].is, 'replay');
});
