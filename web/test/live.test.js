import assert from 'node:assert/strict';
import { test } from 'node:test';
import { follow } from '../src/live.js';
import { Picture } from '../src/wire.js';
import { delta, full } from './frames.js';

/** Sockets that a test opens, feeds and closes by hand. */
function sockets() {
  const opened = [];
  class Socket {
    constructor(url, protocols) {
      Object.assign(this, { url, protocols });
      opened.push(this);
    }

    close(code = 1006) {
      if (this.closed) return;
      this.closed = true;
      this.onclose({ code });
    }
  }
  return { opened, Socket };
}

async function count(opened, wanted) {
  for (let k = 0; k < 200 && opened.length < wanted; k++) await new Promise((done) => { setTimeout(done, 10); });
  assert.equal(opened.length, wanted);
}

const rows = [{ id: 5, kind: 1 }];

test('it resumes by run and seq after a loss, and asks for everything after a frame that does not fit', async () => {
  const { opened, Socket } = sockets();
  const picture = new Picture();
  const states = [];
  const reasons = [];
  const link = follow('ws://here/stream', picture, {
    frame: () => {}, state: (name) => states.push(name), refused: (reason) => reasons.push(reason), Socket,
  });
  assert.equal(opened[0].url, 'ws://here/stream');
  assert.deepEqual(opened[0].protocols, ['coastwatch.picture.v2', 'coastwatch.picture.v1']);
  opened[0].onopen();
  opened[0].onmessage({ data: full({ run: 7, seq: 3 }, rows) });
  opened[0].close();
  await count(opened, 2);
  assert.equal(opened[1].url, 'ws://here/stream?run=7&seq=3');
  opened[1].onmessage({ data: delta({ run: 8, seq: 9, base: 8, slots: 1 }, []) });
  await count(opened, 3);
  assert.equal(opened[2].url, 'ws://here/stream');
  assert.match(reasons[0], /got run 8 and base 8, needed run 7 and base 3/);
  opened[2].onmessage({ data: full({ run: 8, seq: 1 }, rows) });
  assert.deepEqual([picture.run, picture.seq], [8, 1]);
  assert.deepEqual(states, ['waiting', 'open', 'lost', 'lost', 'open']);
  link.stop();
  assert.ok(opened[2].closed);
});

test('where a token is needed it waits for one and does not knock again', async () => {
  const { opened, Socket } = sockets();
  const states = [];
  const link = follow('ws://here/stream', new Picture(), { frame: () => {}, state: (name) => states.push(name), Socket });
  opened[0].close(4401);
  await new Promise((done) => { setTimeout(done, 600); });
  assert.deepEqual([states, opened.length], [['token'], 1]);
  link.retry();
  assert.equal(opened.length, 2);
  link.stop();
});

test('where nothing comes any more it goes on with another socket at once, though the old one is not closed yet', async () => {
  const { opened, Socket } = sockets();
  class Deaf extends Socket { // its network is gone: nobody answers that it is closed
    close() {
      this.asked = true;
    }
  }
  const states = [];
  const link = follow('ws://here/stream', new Picture(), { frame: () => {}, state: (name) => states.push(name), Socket: Deaf, silence_ms: 20 });
  opened[0].onopen();
  await count(opened, 2);
  assert.ok(opened[0].asked);
  assert.deepEqual([opened.length, states], [2, ['waiting', 'lost']]);
  opened[0].onmessage({ data: full({ run: 7, seq: 3 }, rows) }); // too late
  opened[0].onclose({ code: 1006 });
  assert.deepEqual(states, ['waiting', 'lost']);
  link.stop();
});
