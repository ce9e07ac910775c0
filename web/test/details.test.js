import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Details } from '../src/api.js';

const answers = (found) => {
  globalThis.fetch = async (path) => {
    const ids = new URL(path, 'http://here/').searchParams.get('ids').split(',').map(Number);
    return { ok: true, json: async () => ({ vessels: ids.filter(found).map((vessel_id) => ({ vessel_id, name: `SHIP ${vessel_id}` })) }) };
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
