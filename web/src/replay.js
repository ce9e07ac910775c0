// The time slider: it shows stored pictures of the past and plays them. Live pictures go on behind it.

import { getBytes, getJson } from './api.js';
import { byId } from './dom.js';
import { dateClock, seconds } from './formats.js';
import { Picture } from './wire.js';

const SPAN_EVERY_MS = 10000;
const PICTURE_EVERY_MS = 500;

/** `at`: Unix seconds as they are shown now; null: live. */
export class Replay {
  at = null;
  playing = false;
  picture = new Picture();
  #first = NaN;
  #last = NaN;
  #period = 3;
  #wall = 0; // performance.now() at which `at` held
  #busy = false;
  #wanted = null;
  #asked = NaN; // the time of the newest question

  constructor(app) {
    this.app = app;
    this.slider = byId('time');
    this.slider.addEventListener('input', () => this.enter(Number(this.slider.value)));
    byId('live').addEventListener('click', () => this.leave());
    byId('play').addEventListener('click', () => this.play(!this.playing));
    byId('speed').addEventListener('change', (event) => {
      this.#settle();
      app.state.speed = Number(event.target.value);
      app.stateChanged();
    });
    setInterval(() => this.#tick(), PICTURE_EVERY_MS);
    this.loadSpan();
  }

  /** Asks which times are stored. */
  async loadSpan() {
    clearTimeout(this.spanTimer);
    try {
      const span = await getJson('cycles');
      [this.#first, this.#last] = [seconds(span.first_utc), seconds(span.last_utc)];
      this.#period = span.period_s || 3;
      const stored = this.#last > this.#first;
      this.slider.disabled = byId('play').disabled = !stored;
      if (stored) {
        this.slider.min = String(this.#first);
        this.slider.max = String(this.#last);
        this.slider.step = String(this.#period);
      }
      this.draw();
    } catch {
      // The next question may be answered; the slider stays as it is.
    }
    this.spanTimer = setTimeout(() => this.loadSpan(), SPAN_EVERY_MS);
  }

  /** The time that is shown, while playing too. */
  now() {
    if (!this.playing) return this.at;
    const at = this.at + ((performance.now() - this.#wall) / 1000) * this.app.state.speed;
    return Math.min(at, Number.isNaN(this.#last) ? at : this.#last);
  }

  #settle() {
    if (this.at === null) return;
    this.at = this.now();
    this.#wall = performance.now();
  }

  /** Shows the picture of a time. Args: at: Unix seconds. */
  enter(at) {
    if (this.at === null) this.app.forgetVessels();
    this.at = at;
    this.#wall = performance.now();
    this.#fetch(at);
    this.app.modeChanged();
    this.draw();
  }

  play(on) {
    if (this.at === null && on) {
      this.app.forgetVessels();
      this.at = this.#first;
    }
    this.#settle();
    this.#wall = performance.now();
    this.playing = on && this.at !== null;
    if (this.playing) this.#fetch(this.at);
    this.app.modeChanged();
    this.draw();
  }

  /** Back to the live picture. */
  leave() {
    if (this.at !== null) this.app.forgetVessels();
    this.playing = false;
    this.at = null;
    this.#wanted = null;
    this.picture = new Picture();
    this.app.modeChanged();
    this.draw();
  }

  #tick() {
    if (this.at === null) return;
    const now = this.now();
    if (this.playing && now >= this.#last) {
      this.#settle();
      this.playing = false;
      this.app.modeChanged();
    }
    if (this.playing && Math.abs(now - this.#asked) >= this.#period) this.#fetch(now);
    this.draw();
    this.app.stateChanged();
  }

  /** Fetches a picture. While one is on its way only the newest wish is kept. Of a time that is not kept there is none to show. */
  async #fetch(at) {
    this.#wanted = this.#asked = at;
    if (this.#busy) return;
    this.#busy = true;
    while (this.#wanted !== null) {
      const wanted = this.#wanted;
      this.#wanted = null;
      try {
        const bytes = await getBytes(`frame?version=2&at=${new Date(wanted * 1000).toISOString()}`);
        if (this.at === null) break;
        this.picture.apply(bytes);
        this.app.pictureChanged();
      } catch (error) {
        const isKept = ![400, 404].includes(error.status);
        this.app.say(`Replay: ${error.message}${isKept ? '' : '. The picture is live again.'}`);
        if (!isKept && this.at !== null) this.leave();
        break;
      }
    }
    this.#busy = false;
  }

  /** The slider and its text. */
  draw() {
    if (this.app.live.at > this.#last) { // the stored span is asked for less often than pictures come
      this.#last = this.app.live.at;
      this.slider.max = String(this.#last);
    }
    const at = this.at === null ? this.#last : this.now();
    if (Number.isNaN(at)) {
      byId('time-text').textContent = 'nothing is stored yet';
      return;
    }
    if (document.activeElement !== this.slider || this.playing || this.at === null) this.slider.value = String(at);
    const words = `${dateClock(at)} UTC`;
    byId('time-text').textContent = words;
    this.slider.setAttribute('aria-valuetext', words);
    byId('play').textContent = this.playing ? 'Pause' : 'Play';
    byId('live').setAttribute('aria-pressed', String(this.at === null));
  }
}
