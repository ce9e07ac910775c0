import assert from 'node:assert/strict';
import { test } from 'node:test';
import { hull } from '../src/outlines.js';

const near = (got, wanted) => got.forEach((pair, k) => pair.forEach((value, i) => assert.ok(Math.abs(value - wanted[k][i]) < 1e-9)));

test('a ship under way has its bow ahead, by its axis', () => {
  const east = hull({ length: 300, width: 42, axis: 90 }, 8);
  near(east, [[150, 0], [90, -21], [-150, -21], [-150, 21], [90, 21]]);
});

test('a ship at rest is a rectangle, and an unknown width is a sixth of the length', () => {
  near(hull({ length: 120, width: NaN, axis: 0 }, 0.2), [[10, 60], [10, -60], [-10, -60], [-10, 60]]);
  assert.equal(hull({ length: 120, width: 20, axis: 0 }, NaN).length, 4);
});
