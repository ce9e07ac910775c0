import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Picture, RefusedFrame, metresOf, secondsOf } from '../src/wire.js';
import { delta, full, heartbeat } from './frames.js';

const row = (id, more = {}) => ({ id, lon: -13000000, lat: 508000000, sog: 1000, cog: 16384, kind: 3, ...more });
const started = () => {
  const picture = new Picture();
  picture.apply(full({ run: 7, seq: 4 }, [row(11), row(0, { kind: 0 }), row(12, { lat: 509000000 })]));
  return picture;
};

test('a full frame fills the columns, and a slot with id 0 is free', () => {
  const picture = started();
  assert.deepEqual([...picture.slotOf], [[11, 0], [12, 2]]);
  assert.equal(picture.vessels, 2);
  const vessel = picture.vessel(0);
  assert.deepEqual([vessel.lat, vessel.lon, vessel.sog, vessel.cog], [50.8, -1.3, 10, 90]);
  assert.ok(Math.abs(picture.place[0] / 2 ** 32 - 178.7 / 360) < 1e-9);
});

test('a delta changes, removes and adds, and the rest stays', () => {
  const picture = started();
  picture.apply(delta({ run: 7, seq: 5, base: 4, slots: 4, time: 1003 },
    [{ slot: 0, ...row(11, { sog: 1200 }) }, { slot: 3, born: true, ...row(13) }], [2]));
  assert.deepEqual([...picture.slotOf], [[11, 0], [13, 3]]);
  assert.equal(picture.sog[0], 1200);
  assert.equal(picture.id[2], 0);
  assert.deepEqual([picture.time[0], picture.seq, picture.slots], [3, 5, 4]);
});

test('after many deltas the columns equal those of a fresh full frame', () => {
  let seed = 5;
  const random = (below) => { seed = (seed * 1103515245 + 12345) % 2147483648; return Math.floor((seed / 2147483648) * below); };
  const picture = new Picture();
  const rows = Array.from({ length: 50 }, (_, k) => row(k + 1, { sog: random(3000), age: random(200) }));
  picture.apply(full({ run: 1, seq: 1 }, rows));
  let next = 51;
  for (let seq = 2; seq < 202; seq++) {
    const changed = new Map();
    const free = rows.map((r, k) => (r.id ? -1 : k)).filter((k) => k >= 0);
    if (free.length && seq % 2) {
      const slot = free[random(free.length)];
      rows[slot] = row(next++, { lat: random(800000000) });
      changed.set(slot, { slot, born: true, ...rows[slot] });
    } else if (seq % 7 === 0) {
      rows.push(row(next++));
      changed.set(rows.length - 1, { slot: rows.length - 1, born: true, ...rows.at(-1) });
    }
    const removed = [];
    for (let k = 0; k < 5; k++) {
      const slot = random(rows.length);
      if (!rows[slot].id || changed.has(slot) || removed.includes(slot)) continue;
      if (k === 0) { removed.push(slot); rows[slot] = { id: 0 }; continue; }
      Object.assign(rows[slot], { sog: random(3000), lon: random(1800000000), flag: random(128) });
      changed.set(slot, { slot, ...rows[slot] });
    }
    picture.apply(delta({ run: 1, seq, base: seq - 1, slots: rows.length }, [...changed.values()], removed));
  }
  const fresh = new Picture();
  fresh.apply(full({ run: 1, seq: 201 }, rows));
  assert.deepEqual([...picture.slotOf].sort(), [...fresh.slotOf].sort());
  for (const [, slot] of fresh.slotOf) {
    for (const name of ['id', 'lon', 'lat', 'sog', 'cog', 'kind', 'flag', 'age']) assert.equal(picture[name][slot], fresh[name][slot], name);
    assert.equal(picture.place[2 * slot], fresh.place[2 * slot]);
  }
});

test('a frame of another run, base, format or length is refused and leaves the picture as it was', () => {
  const picture = started();
  const good = full({ run: 7, seq: 5 }, [row(1)]);
  const other = new Uint8Array(good.slice(0));
  other[0] = 0;
  const tooMany = new DataView(good.slice(0));
  tooMany.setUint32(24, 3, true);
  const bad = {
    run: delta({ run: 8, seq: 5, base: 4, slots: 3 }, []),
    base: delta({ run: 7, seq: 6, base: 5, slots: 3 }, []),
    slot: delta({ run: 7, seq: 5, base: 4, slots: 3 }, [{ slot: 3, ...row(1) }]),
    cut: good.slice(0, good.byteLength - 4),
    short: good.slice(0, 20),
    magic: other.buffer,
    slots: tooMany.buffer,
    heartbeat: heartbeat({ run: 8, seq: 4 }),
  };
  for (const [name, frame] of Object.entries(bad)) {
    assert.throws(() => picture.apply(frame), RefusedFrame, name);
    assert.deepEqual([picture.seq, picture.vessels, picture.sog[0]], [4, 2, 1000], name);
  }
});

test('a full frame of a new run replaces everything', () => {
  const picture = started();
  picture.apply(full({ run: 9, seq: 1, time: 5000 }, [row(99)]));
  assert.deepEqual([...picture.slotOf], [[99, 0]]);
  assert.equal(picture.id[2], 0);
  assert.deepEqual([picture.run, picture.epoch, picture.time[0]], [9, 5000, 0]);
});

test('a slot may change its vessel without being removed, and a vessel its slot', () => {
  const picture = started();
  picture.apply(delta({ run: 7, seq: 9, base: 4, slots: 3 }, [{ slot: 0, born: true, ...row(12) }, { slot: 2, born: true, ...row(14) }]));
  assert.deepEqual([...picture.slotOf].sort(), [[12, 0], [14, 2]]);
});

test('a delta from nothing replaces everything, whatever the page had', () => {
  const picture = started();
  picture.apply(delta({ run: 9, seq: 3, base: 0, slots: 6, time: 5000 }, [{ slot: 5, born: true, ...row(77) }]));
  assert.deepEqual([...picture.slotOf], [[77, 5]]);
  assert.deepEqual([picture.id[0], picture.kind[2], picture.slots, picture.epoch], [0, 0, 6, 5000]);
});

test('a heartbeat changes nothing', () => {
  const picture = started();
  const before = picture.version;
  assert.equal(picture.apply(heartbeat({ run: 7, seq: 4 })), -1);
  assert.equal(picture.version, before);
});

test('a vessel moves on from the frame that had it, at most ten minutes', () => {
  const picture = started();
  assert.equal(picture.position(0, 1000)[1], -1.3);
  const [lat, lon] = picture.position(0, 1060);
  const east = (lon + 1.3) * Math.cos((50.8 * Math.PI) / 180) * 111120;
  assert.ok(Math.abs(lat - 50.8) < 1e-9 && Math.abs(east - 308.6667) < 0.01);
  assert.deepEqual(picture.position(0, 1600), picture.position(0, 9000));
});

test('bytes of the ellipse and of the age', () => {
  assert.equal(metresOf(16), 1);
  assert.ok(Number.isNaN(metresOf(255)));
  assert.deepEqual([secondsOf(0), secondsOf(16)], [0, 2]);
});

test('a frame of version 2 has sizes by radar, and one without them says that none is known', () => {
  const picture = new Picture();
  picture.apply(full({ run: 7, seq: 1 }, [row(11, { length: 148, width: 255, axis: 64 }), row(12)]));
  const { length, width, axis } = picture.size(0);
  assert.deepEqual([Math.round(length), width, axis], [304, NaN, 90]);
  assert.equal(picture.size(1), null);
  picture.apply(delta({ run: 7, seq: 2, base: 1, slots: 2 }, [{ slot: 0, ...row(11) }]));
  assert.equal(picture.size(0), null);
  assert.throws(() => { const odd = full({ run: 7, seq: 3 }, [row(1)]); new DataView(odd).setUint16(6, 1, true); picture.apply(odd); }, RefusedFrame);
});
