// Keeps a picture live over the WebSocket: resumes after a loss, and asks for a full frame where one does not fit.

import { RefusedFrame, SUBPROTOCOLS } from './wire.js';

const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 8000;
const SILENCE_MS = 30000; // the server sends a heartbeat each 10 s
/** Close codes after which it is not tried again, and what is told. */
const FINAL = { 4401: 'token', 4404: 'none' };

/**
 * Follows a server until stopped.
 * @param {string} url of the WebSocket, without query
 * @param {import('./wire.js').Picture | import('./video.js').VideoPicture} picture written by each frame
 * @param {{frame: (changed: number, bytes: number, ms: number) => void, state: (name: 'waiting'|'open'|'lost'|'token'|'none') => void,
 *   refused?: (reason: string) => void, protocols?: string[], Socket?: typeof WebSocket, silence_ms?: number}} told
 *   `changed`: rows, -1 for a heartbeat; `waiting`: connected, before a frame has come; `none`: there is nothing to follow; `silence_ms`: then the network is gone
 * @returns {{stop: () => void, retry: () => void, send: (text: string) => void}}
 */
export function follow(url, picture, {
  frame, state, refused = () => {}, protocols = SUBPROTOCOLS, Socket = globalThis.WebSocket, silence_ms = SILENCE_MS,
}) {
  let wait = FIRST_WAIT_MS;
  let resume = false;
  let socket;
  let again;
  let silence;

  const later = () => {
    clearTimeout(silence);
    state('lost');
    again = setTimeout(open, wait * (0.5 + Math.random()));
    wait = Math.min(wait * 2, LONGEST_WAIT_MS);
  };
  /** Goes on without a socket: where the network is gone, closing it takes as long as the browser waits for an answer. */
  const abandon = () => {
    const old = socket;
    socket = null;
    old.close();
    later();
  };
  const heard = () => {
    clearTimeout(silence);
    silence = setTimeout(abandon, silence_ms);
  };
  const open = () => {
    const query = resume ? `?run=${picture.run}&seq=${picture.seq}` : '';
    const mine = new Socket(url + query, protocols);
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
        abandon();
      }
    };
    mine.onclose = ({ code }) => {
      if (mine !== socket) return;
      if (FINAL[code]) {
        clearTimeout(silence);
        state(FINAL[code]);
        return;
      }
      later();
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
    send: (text) => socket?.send(text),
    retry() {
      stop();
      wait = FIRST_WAIT_MS;
      open();
    },
  };
}
