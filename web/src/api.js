// Asks the REST API, and keeps the details of vessels (name, MMSI, type, size) that are not in the picture.

const BATCH = 200; // vessels in one request
const PAGE = 10000;
const STALE_MS = 120000;
const WAIT_MS = 100; // between requests: a server limits how fast one page may ask

/** An answer other than 2xx: `status` and the sentence of the server. */
export class ApiError extends Error {
  constructor(status, sentence) {
    super(sentence);
    this.status = status;
  }
}

/** Fetches and checks the status. Args: path: after /api/v1/. */
export async function ask(path, options = {}) {
  const answer = await fetch(`./api/v1/${path}`, { credentials: 'same-origin', ...options });
  if (answer.ok) return answer;
  const body = await answer.json().catch(() => ({}));
  throw new ApiError(answer.status, typeof body.detail === 'string' ? body.detail : `${path}: the server answered ${answer.status}`);
}

export const getJson = async (path) => (await ask(path)).json();
export const getBytes = async (path) => (await ask(path)).arrayBuffer();

export const sendJson = async (method, path, body) =>
  (await ask(path, { method, headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(body) })).json();
export const postJson = (path, body) => sendJson('POST', path, body);

/** Exchanges a token for the cookie of this page. */
export async function openSession(token) {
  const answer = await fetch('./session', {
    method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ token }), credentials: 'same-origin',
  });
  if (!answer.ok) throw new ApiError(answer.status, 'The token was not accepted.');
}

/** Details of vessels by id, fetched when they are first needed. */
export class Details extends Map {
  #asked = new Map(); // id to the time at which it was asked for
  #waiting = new Set();
  #timer = null;

  /** @param {() => void} told called when details have come */
  constructor(told) {
    super();
    this.told = told;
  }

  /** Asks for those vessels of which nothing is known, or nothing fresh. Args: ids: iterable. */
  need(ids) {
    const now = performance.now();
    for (const id of ids) {
      if (now - (this.#asked.get(id) ?? -Infinity) > STALE_MS) this.#waiting.add(id);
    }
    if (this.#waiting.size) this.#timer ??= setTimeout(() => this.#fetch(), WAIT_MS);
  }

  async #fetch() {
    const ids = [...this.#waiting].slice(0, BATCH);
    const now = performance.now();
    ids.forEach((id) => {
      this.#waiting.delete(id);
      this.#asked.set(id, now);
    });
    try {
      const { vessels } = await getJson(`vessels?ids=${ids.join(',')}`);
      for (const vessel of vessels) this.set(vessel.vessel_id, vessel);
      this.told();
    } catch {
      ids.forEach((id) => this.#asked.set(id, now - STALE_MS + 5000)); // again in five seconds
    }
    this.#timer = this.#waiting.size ? setTimeout(() => this.#fetch(), WAIT_MS) : null;
  }

  /** Fetches the details of every vessel of the newest picture: for filters and sorting by them. */
  async all() {
    const columns = 'vessel_id,name,call_sign,mmsi,ship_type,length_m,beam_m';
    for (let offset = 0, total = 1; offset < total; offset += PAGE) {
      const page = await getJson(`picture?columns=${columns}&limit=${PAGE}&offset=${offset}`);
      total = page.total;
      for (const vessel of page.vessels) this.set(vessel.vessel_id, { ...this.get(vessel.vessel_id), ...vessel });
      if (!page.vessels.length) break;
    }
    this.told();
  }

  /** Forgets everything: another run has other vessels. */
  clear() {
    super.clear();
    this.#asked?.clear();
    this.#waiting?.clear();
  }
}
