// Keeps a picture live over the WebSocket: resumes after a loss, and asks for a full frame where one does not fit.

import { RefusedFrame, SUBPROTOCOL } from './wire.js';

const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 8000;
const SILENCE_MS = 30000; // the server sends a heartbeat each 10 s
const TOKEN_NEEDED = 4401;

/**
 * Follows a server until stopped.
 * @param {string} url of the WebSocket, without query
 * @param {import('./wire.js').Picture} picture written by each frame
 * @param {{frame: (changed: number, bytes: number, ms: number) => void, state: (name: 'waiting'|'open'|'lost'|'token') => void,
 *   refused?: (reason: string) => void, Socket?: typeof WebSocket}} told
 *   `changed`: rows, -1 for a heartbeat; `waiting`: connected, before a frame has come
 * @returns {{stop: () => void, retry: () => void}}
 */
export function follow(url, picture, { frame, state, refused = () => {}, Socket = globalThis.WebSocket }) {
  let wait = FIRST_WAIT_MS;
  let resume = false;
  let socket;
  let again;
  let silence;

  const heard = () => {
    clearTimeout(silence);
    silence = setTimeout(() => socket.close(), SILENCE_MS);
  };
  const open = () => {
    const query = resume ? `?run=${picture.run}&seq=${picture.seq}` : '';
    const mine = new Socket(url + query, [SUBPROTOCOL]);
    socket = mine;
    mine.binaryType = 'arraybuffer';
    heard();
    mine.onopen = () => { if (mine === socket) state('waiting'); };
    mine.onmessage = ({ data }) => {
      if (mine !== socket) return;
      const began = performance.now();
      heard();
      try {
        const changed = picture.apply(data);
        resume = true;
        wait = FIRST_WAIT_MS;
        state('open');
        frame(changed, data.byteLength, performance.now() - began);
      } catch (error) {
        if (!(error instanceof RefusedFrame)) throw error;
        resume = false;
        refused(error.message);
        mine.close();
      }
    };
    mine.onclose = ({ code }) => {
      if (mine !== socket) return;
      clearTimeout(silence);
      if (code === TOKEN_NEEDED) {
        state('token');
        return;
      }
      state('lost');
      again = setTimeout(open, wait * (0.5 + Math.random()));
      wait = Math.min(wait * 2, LONGEST_WAIT_MS);
    };
  };
  const stop = () => {
    clearTimeout(again);
    clearTimeout(silence);
    const last = socket;
    socket = null;
    last?.close();
  };
  open();
  return {
    stop,
    retry() {
      stop();
      wait = FIRST_WAIT_MS;
      open();
    },
  };
}
