import assert from 'node:assert/strict';
import { test } from 'node:test';
import { takesKey } from '../src/controls.js';

const input = (type) => ({ tagName: 'INPUT', type });

test('keys go to fields, Space and Enter to buttons, and none to a slider that was used', () => {
  const keys = [' ', 'l', 't', 'n', '/', 'Enter'];
  const taken = (control) => keys.filter((key) => takesKey(control, key));
  assert.deepEqual(taken(null), []);
  assert.deepEqual(taken(input('range')), []);
  for (const control of [{ tagName: 'BUTTON' }, { tagName: 'SUMMARY' }, { tagName: 'A' }, input('checkbox')]) {
    assert.deepEqual(taken(control), [' ', 'Enter']);
  }
  for (const control of [input('text'), input('number'), input('search'), { tagName: 'SELECT' }, { tagName: 'TEXTAREA' }]) {
    assert.deepEqual(taken(control), keys);
  }
});
