import assert from 'node:assert/strict';
import { test } from 'node:test';
import { definitionOf, draftOf, pointsOf, ruleWords } from '../src/zone_shapes.js';

const RULES = { enter: true, leave: false, dwell_s: 600, min_speed_kn: null, max_speed_kn: 12, crossing: 'both' };

test('a polygon has its corners and the rules of an area', () => {
  const zone = definitionOf({ name: ' bay ', kind: 'polygon', ...RULES }, [[1, 2], [1, 181], [2, 3]]);
  assert.deepEqual(zone, {
    name: 'bay', kind: 'polygon', points_deg: [[1, 2], [1, -179], [2, 3]], enter: true, dwell_s: 600, max_speed_kn: 12,
  });
  assert.equal(ruleWords(zone), 'enter, stay over 10 min, over 12 kn');
});

test('a circle goes through the place that was clicked, and comes back', () => {
  const zone = definitionOf({ name: 'ring', kind: 'circle', ...RULES }, [[50, -1], [50, -0.9]]);
  assert.ok(Math.abs(zone.radius_nm - 3.86) < 0.01);
  assert.ok(Math.abs(definitionOf({ name: 'ring', kind: 'circle' }, pointsOf(zone)).radius_nm - zone.radius_nm) < 0.01);
  assert.equal(draftOf('circle', pointsOf(zone)).features[0].geometry.coordinates.length, 73);
});

test('a line has a direction and no rules of an area', () => {
  const zone = definitionOf({ name: 'bar', kind: 'line', ...RULES, crossing: 'to_left' }, [[1, 2], [3, 4]]);
  assert.deepEqual(zone, { name: 'bar', kind: 'line', points_deg: [[1, 2], [3, 4]], crossing: 'to_left' });
  assert.equal(ruleWords(zone), 'cross to left');
});
