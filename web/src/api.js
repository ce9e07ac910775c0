// Asks the REST API, and keeps the details of vessels (name, MMSI, type, size) that are not in the picture.

const BATCH = 200; // vessels in one request
const PAGE = 10000;
const STALE_MS = 120000;
export const MOST_KEPT = 5000; // vessels whose details are kept, unless the picture has more
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

export const getJson = async (path, options) => (await ask(path, options)).json();
/** The question for an instant. Args: at: Unix seconds, null: none; mark: before it. Cycles lie more than a millisecond apart. */
export const atOf = (at, mark) => (at === null ? '' : `${mark}at=${new Date(Math.ceil(at * 1000)).toISOString()}`);

export const getBytes = async (path) => (await ask(path)).arrayBuffer();

export const sendJson = async (method, path, body, headers = {}) =>
  (await ask(path, { method, headers: { 'Content-Type': 'application/json', ...headers }, body: JSON.stringify(body) })).json();
export const postJson = (path, body) => sendJson('POST', path, body);

/** Exchanges a token for the cookie of this page. */
export async function openSession(token) {
  const answer = await fetch('./session', {
    method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ token }), credentials: 'same-origin',
  });
  if (!answer.ok) throw new ApiError(answer.status, 'The token was not accepted.');
}

/** Details of vessels by id, fetched when they are first needed. Those that were needed longest ago are forgotten. */
export class Details extends Map {
  #asked = new Map(); // id to the time at which it was asked for
  #waiting = new Set();
  #timer = null;
  #run = null; // of the newest answer
  #times = 0; // how often everything was forgotten

  /**
   * @param {() => void} told called when details have come
   * @param {() => number} room for how many vessels there is room: all of the picture, where a filter or a sort asks for them
   * @param {() => number | null} instant of the picture that is shown, Unix seconds; null: it is live
   */
  constructor(told, room = () => MOST_KEPT, instant = () => null) {
    super();
    Object.assign(this, { told, room, instant });
  }

  /** Keeps what is known of a vessel: values, not the lists of its panel. */
  set(id, vessel) {
    this.delete(id);
    super.set(id, Object.fromEntries(Object.entries(vessel).filter(([, value]) => value === null || typeof value !== 'object')));
    this.#forget();
    return this;
  }

  /** Asks for those vessels of which nothing is known, or nothing fresh. Args: ids: iterable. */
  need(ids) {
    const now = performance.now();
    for (const id of ids) {
      const known = this.get(id);
      if (known) {
        this.delete(id); // it is now the one that was needed last
        super.set(id, known);
      }
      if (now - (this.#asked.get(id) ?? -Infinity) > STALE_MS) this.#waiting.add(id);
    }
    if (this.#waiting.size) this.#timer ??= setTimeout(() => this.#fetch(), WAIT_MS);
  }

  /** How many vessels it remembers to have asked for. */
  get asked() {
    return this.#asked.size;
  }

  #noteAsked(id, at) {
    this.#asked.delete(id);
    this.#asked.set(id, at);
  }

  /** Forgets those that were needed longest ago where there is no more room. */
  #forget() {
    const room = this.room();
    for (const map of [this, this.#asked]) {
      for (const id of map.keys()) {
        if (map.size <= room) break;
        map.delete(id);
      }
    }
  }

  async #fetch() {
    const ids = [...this.#waiting].slice(0, BATCH);
    const now = performance.now();
    const times = this.#times;
    ids.forEach((id) => {
      this.#waiting.delete(id);
      this.#noteAsked(id, now);
    });
    this.#forget();
    try {
      const { run, vessels } = await getJson(`vessels?ids=${ids.join(',')}${atOf(this.instant(), '&')}`);
      if (times === this.#times) {
        if (this.#run !== null && run !== this.#run) this.clear(); // another run has other vessels under these ids
        this.#run = run;
        for (const vessel of vessels) this.set(vessel.vessel_id, vessel);
        this.told();
      }
    } catch {
      ids.forEach((id) => this.#noteAsked(id, now - STALE_MS + 5000)); // again in five seconds
    }
    this.#timer = this.#waiting.size ? setTimeout(() => this.#fetch(), WAIT_MS) : null;
  }

  /** Fetches the details of every vessel of the newest picture: for filters and sorting by them. */
  async all() {
    const columns = 'vessel_id,name,call_sign,mmsi,ship_type,length_m,beam_m';
    for (let offset = 0, total = 1; offset < total; offset += PAGE) {
      const page = await getJson(`picture?columns=${columns}&limit=${PAGE}&offset=${offset}${atOf(this.instant(), '&')}`);
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
    this.#run = null;
    this.#times += 1;
  }
}
