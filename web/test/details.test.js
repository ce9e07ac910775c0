import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Details } from '../src/api.js';

const answers = (found, run = () => 1) => {
  globalThis.fetch = async (path) => {
    const asked = new URL(path, 'http://here/').searchParams;
    const ids = asked.get('ids').split(',').map(Number);
    return { ok: true, json: async () => ({ run: run(asked.get('at')), vessels: ids.filter(found).map((vessel_id) => ({ vessel_id, name: `SHIP ${vessel_id}` })) }) };
  };
};

test('details are kept of so many vessels, and those that were needed longest ago go first', () => {
  const details = new Details(() => {}, () => 3);
  for (const id of [1, 2, 3]) details.set(id, { name: `SHIP ${id}` });
  details.need([1]); // it is in sight
  details.set(4, { name: 'SHIP 4' });
  assert.deepEqual([...details.keys()], [3, 1, 4]);
  details.set(3, { name: 'SHIP 3', history: [1, 2], area: null, length_m: 3 });
  assert.deepEqual([[...details.keys()], details.get(3)], [[1, 4, 3], { name: 'SHIP 3', area: null, length_m: 3 }]);
});

test('vessels that were asked for are remembered within the same bound, also where the server knows none of them', async () => {
  answers((id) => id % 2 === 0);
  const told = [];
  const details = new Details(() => told.push(1), () => 10);
  details.need(Array.from({ length: 300 }, (_, k) => k + 1));
  for (let k = 0; k < 200 && told.length < 2; k++) await new Promise((done) => { setTimeout(done, 10); });
  assert.equal(told.length, 2); // requests of 200 ids at most
  assert.deepEqual([details.size, details.asked], [10, 10]);
  assert.deepEqual([...details.keys()].at(-1), 300);
});

test('of another run everything else is forgotten, and of another time what was on its way', async () => {
  answers(() => true, (at) => (at === '2026-11-24T12:00:00.000Z' ? 1 : 2));
  let at = Date.parse('2026-11-24T12:00:00Z') / 1000 - 0.0004; // of the shown picture: its cycle is not earlier than asked for
  const details = new Details(() => {}, () => 10, () => at);
  const come = async () => { for (let k = 0; k < 30; k++) await new Promise((done) => { setTimeout(done, 10); }); };
  details.need([1]);
  await come();
  assert.deepEqual([...details.keys()], [1]);
  at = null;
  details.need([2]);
  await come();
  assert.deepEqual([...details.keys()], [2]);
  globalThis.fetch = async () => {
    details.clear();
    return { ok: true, json: async () => ({ run: 2, vessels: [{ vessel_id: 3 }] }) };
  };
  details.need([3]);
  await come();
  assert.equal(details.size, 0);
});
