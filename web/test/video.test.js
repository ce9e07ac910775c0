import assert from 'node:assert/strict';
import { deflateSync } from 'node:zlib';
import { test } from 'node:test';
import { radii } from '../src/geodesy.js';
import { paintSector, radarsInView, VideoPicture } from '../src/video.js';
import { RefusedFrame } from '../src/wire.js';

/** A message by the table of INTERFACE.md. */
function message({ kind = 1, radar = 0, run = 7, seq = 1, begun = 0, place = 0, range = 6000, octets = new Uint8Array(64 * 256) } = {}) {
  const data = kind === 1 ? deflateSync(octets) : new Uint8Array(0);
  const made = new Uint8Array(64 + data.length);
  const view = new DataView(made.buffer);
  made.set([...'CWV1'].map((letter) => letter.charCodeAt(0)));
  made.set([1, kind], 4);
  view.setUint16(6, radar, true);
  [run, seq, begun].forEach((value, k) => view.setUint32(8 + 4 * k, value, true));
  made.set([place, 16], 20);
  view.setUint16(22, 64, true);
  view.setUint16(24, 512, true);
  [1000, 54.3, 12].forEach((value, k) => view.setFloat64(32 + 8 * k, value, true));
  view.setFloat32(56, range, true);
  made.set(data, 64);
  return made.buffer;
}

function waiting() {
  const made = {};
  made.promise = new Promise((resolve) => { made.resolve = resolve; });
  return made;
}

const greeting = JSON.stringify({ run: 7, radars: ['north', 'south'] });
const filled = (value) => new Uint8Array(64 * 256).fill(value);

test('a sector is at its place with the nearer level first', async () => {
  const told = [];
  const picture = new VideoPicture(() => told.push(1));
  assert.equal(picture.apply(greeting), 0);
  assert.deepEqual(picture.names, ['north', 'south']);
  assert.equal(picture.apply(message({ place: 3, seq: 9, radar: 1, octets: filled(0xf1) })), 64);
  await picture.done;
  const { cells, changed, lat, lon, range } = picture.radars.get(1);
  assert.deepEqual([...cells.subarray(3 * 32768, 3 * 32768 + 4)], [255, 17, 255, 17]);
  assert.deepEqual([cells[3 * 32768 - 1], cells[4 * 32768], cells.length], [0, 0, 1024 * 512]);
  assert.deepEqual([[...changed], lat, lon, range, picture.seq, told.length], [[3], 54.3, 12, 6000, 9, 1]);
  assert.equal(picture.apply(message({ kind: 5 })), -1);
});

test('another range scale or run begins anew; what is late is written in its order', async () => {
  const picture = new VideoPicture();
  picture.apply(greeting);
  picture.apply(message({ seq: 1, octets: filled(0x11) }));
  picture.apply(message({ seq: 2, octets: filled(0x22) }));
  await picture.done;
  assert.equal(picture.radars.get(0).cells[0], 34);
  picture.apply(message({ seq: 3, begun: 2, place: 1, octets: filled(0x33) }));
  await picture.done;
  assert.deepEqual([picture.radars.get(0).cells[0], picture.radars.get(0).cells[32768]], [0, 51]);
  picture.apply(JSON.stringify({ run: 8, radars: ['north'] }));
  assert.deepEqual([picture.radars.size, picture.seq], [0, 0]);
});

test('a sector that is inflated after its picture was cleared is not drawn', async () => {
  const picture = new VideoPicture();
  picture.apply(greeting);
  picture.apply(message());
  picture.clear();
  await picture.done;
  assert.equal(picture.radars.size, 0);
  picture.apply(message());
  await picture.done;
  assert.equal(picture.radars.size, 1);
});

test('another format, run or size is refused, and a damaged sector changes nothing', async () => {
  const picture = new VideoPicture();
  picture.apply(greeting);
  for (const wrong of [new ArrayBuffer(8), message({ run: 6 }), message({ kind: 2 }), message({ place: 16 })]) {
    assert.throws(() => picture.apply(wrong), RefusedFrame);
  }
  const { promise, resolve } = waiting();
  picture.done = promise; // a damaged sector that fails while one before it is not written yet
  picture.apply(message({ octets: new Uint8Array(10) }));
  picture.apply(message().slice(0, 70));
  await new Promise((done) => setTimeout(done, 50));
  resolve();
  await picture.done;
  assert.equal(picture.radars.size, 0);
});

test('afterglow keeps a share of what was there, and never weakens what is', () => {
  const cells = new Uint8Array([200, 100, 0, 0]);
  paintSector(cells, new Uint8Array([0x0f, 0x30]), 0.5);
  assert.deepEqual([...cells], [100, 255, 51, 0]);
  paintSector(cells, new Uint8Array([0, 0]), 0);
  assert.deepEqual([...cells], [0, 0, 0, 0]);
});

test('radii of the ellipsoid', () => {
  assert.ok(Math.abs(radii(0).north - 6335439.327) < 0.01 && Math.abs(radii(90).east - 6399593.626) < 0.01);
});

test('video is asked for of radars whose range meets the view, or whose place is not known', () => {
  const radar = (name, latitude_deg, longitude_deg, range_m = 20000) => ({ kind: 'radar', name, latitude_deg, longitude_deg, range_m });
  const sensors = [radar('near', 54.3, 12), radar('edge', 54.3, 12.7), radar('far', 54.3, 14), radar('moving', null, null), radar('fiji', -17, 179.95)];
  const names = ['near', 'edge', 'far', 'moving', 'fiji', 'unknown'];
  assert.deepEqual(radarsInView(names, sensors, { west: 11.5, south: 54, east: 12.5, north: 54.6 }), ['near', 'edge', 'moving', 'unknown']);
  assert.deepEqual(radarsInView(names, sensors, { west: -180.5, south: -18, east: -179.9, north: -16 }), ['moving', 'fiji', 'unknown']);
  assert.deepEqual(radarsInView(names, sensors, { west: 11.5, south: 54.5, east: 12.5, north: 54.6 }), ['moving', 'unknown']);
});
