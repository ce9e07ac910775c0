// Alarms: the list, unacknowledged first, the line at the bottom, and their acknowledgement with a name.
// The server finds alarms. They come over server-sent events where it has them, and are asked for again in any case.

import { getJson, postJson } from './api.js';
import { byId, element, fill } from './dom.js';
import { clock, dateClock, label, seconds, text } from './formats.js';

const ASK_MS = 3000;
const ASK_WITH_STREAM_MS = 15000;
const MOST = 500; // that wait
const MOST_DONE = 200;
const MOST_ROWS = MOST + MOST_DONE;
const NAME_KEY = 'coastwatch.name';

const lasting = (alarm) => !alarm.end_utc;
const open = (alarm) => !alarm.acknowledged_by;
const zoneOf = ({ kind, subject }) => (/^(zone_|line_)/.test(kind) ? String(subject) : '');

export class Alarms {
  rows = [];
  flashing = new Set(); // vessel ids with a lasting alarm that nobody has acknowledged
  #heard = null; // ids of the alarms of the last answer; null: none yet, so that a new page does not shout
  #timer = null;
  #streaming = false;
  #changes = 0; // acknowledgements from this page
  #failed = 'the server has not answered yet'; // why the alarms are not those of now; empty: they are
  #unread = 0; // that wait and are older than those of `rows`

  constructor(app) {
    this.app = app;
    const name = byId('watch-name');
    name.value = localStorage.getItem(NAME_KEY) ?? '';
    name.addEventListener('change', () => localStorage.setItem(NAME_KEY, name.value.trim()));
    name.addEventListener('keydown', ({ key }) => ['Enter', 'Escape'].includes(key) && name.blur()); // A then acknowledges
    for (const id of ['alarm-kind', 'alarm-zone']) byId(id).addEventListener('change', () => this.update());
    byId('acknowledge-shown').addEventListener('click', () => this.acknowledgeShown());
    byId('strip-acknowledge').addEventListener('click', () => this.acknowledgeFirst());
    byId('strip-show').addEventListener('click', () => this.#select(this.first()));
    this.#listen();
  }

  /** Takes alarms as they come. A server without the stream answers 404: asking is then enough. */
  #listen() {
    const stream = new EventSource('./api/v1/alarms/stream');
    stream.onopen = () => { this.#streaming = true; };
    stream.addEventListener('alarm', () => { // many may come at once: one question answers them
      clearTimeout(this.#timer);
      this.#timer = setTimeout(() => this.load(), 100);
    });
    stream.onerror = () => {
      this.#streaming = false;
      clearTimeout(this.#timer);
      this.#timer = setTimeout(() => this.load(), 1000);
    };
  }

  /** Asks for the alarms now, and again later: every one that waits, however old, and the newest of the others. */
  async load() {
    clearTimeout(this.#timer);
    try {
      const changes = this.#changes;
      const [waiting, newest] = await Promise.all([
        getJson(`alarms?state=unacknowledged&limit=${MOST}`), getJson(`alarms?state=all&limit=${MOST_DONE}`)]);
      this.#failed = '';
      if (changes === this.#changes) { // else the answer is older than what was acknowledged
        this.#unread = waiting.total - waiting.alarms.length;
        const both = new Map([...waiting.alarms, ...newest.alarms].map((alarm) => [alarm.alarm_id, alarm]));
        this.#take([...both.values()]);
      }
    } catch (error) {
      if (error.status) this.app.say(error.message);
      this.#failed = error.status ? error.message : 'the server does not answer';
      this.update();
    }
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.load(), this.#streaming ? ASK_WITH_STREAM_MS : ASK_MS);
  }

  #take(alarms) {
    const rank = (alarm) => (open(alarm) ? 0 : 2) + (lasting(alarm) ? 0 : 1);
    this.rows = [...alarms].sort((a, b) => rank(a) - rank(b) || seconds(b.start_utc) - seconds(a.start_utc));
    this.flashing = new Set(this.rows.filter((alarm) => open(alarm) && lasting(alarm)).map((alarm) => alarm.vessel_id));
    const fresh = this.#heard ? this.rows.filter((alarm) => open(alarm) && !this.#heard.has(alarm.alarm_id)) : [];
    this.#heard = new Set(alarms.map((alarm) => alarm.alarm_id));
    if (fresh.length) {
      byId('shout').textContent = fresh.slice(0, 3).map((alarm) => `Alarm: ${words(alarm)}`).join('. ');
    }
    this.app.alarmsChanged();
    this.update();
  }

  /** The gravest alarm that nobody has acknowledged: lasting ones before ended ones, newest first. */
  first() {
    return this.rows.find(open);
  }

  /** How many alarms nobody has acknowledged. */
  count() {
    return this.rows.filter(open).length + this.#unread;
  }

  /** Draws the line at the bottom and, where it is open, the list. */
  update() {
    const first = this.first();
    const waiting = this.count();
    byId('strip').hidden = !first;
    if (first) {
      byId('strip-text').textContent = `${this.app.replaying ? 'Now: ' : ''}${words(first)}, ${dateClock(seconds(first.start_utc))}${lasting(first) ? '' : ', ended'}`;
      byId('strip-count').textContent = waiting > 1 ? `1 of ${waiting} to acknowledge` : '';
    }
    byId('alarm-count').textContent = this.#heard ? String(waiting) : '–';
    byId('open-alarms').title = `${waiting} to acknowledge`;
    if (this.app.state.drawer !== 'alarms') return;
    const focused = document.activeElement?.closest('[data-alarm]')?.dataset.alarm;
    const list = byId('alarm-rows');
    const [kind, zone] = [byId('alarm-kind').value, byId('alarm-zone').value];
    const kinds = new Set([...this.rows.map((alarm) => alarm.kind), kind].filter(Boolean));
    fill(byId('alarm-kind'), element('option', { value: '' }, 'all'),
      [...kinds].sort().map((name) => element('option', { value: name, selected: name === kind }, name.replaceAll('_', ' '))));
    const zones = new Set([...this.rows.map(zoneOf), zone].filter(Boolean));
    fill(byId('alarm-zone'), element('option', { value: '' }, 'all'),
      [...zones].map((number) => element('option', { value: number, selected: number === zone }, this.#zoneName(number))));
    const rows = this.#chosen();
    const here = rows.filter(open).length;
    const last = rows.filter((alarm) => open(alarm) && lasting(alarm)).length;
    const older = kind || zone ? 0 : this.#unread;
    const sum = here ? `${here + older} to acknowledge: ${last} lasting, ${here - last} ended${older ? `, ${older} older` : ''}` : 'Nothing to acknowledge.';
    byId('acknowledge-shown').disabled = here === 0;
    byId('acknowledge-shown').textContent = here ? `Acknowledge all ${here} shown` : 'Acknowledge all shown';
    byId('alarm-words').textContent = this.#failed ? `Not up to date: ${this.#failed}.` : sum;
    fill(list, rows.length ? rows.slice(0, MOST_ROWS).map((alarm) => this.#row(alarm)) : element('li', { class: 'soft' }, this.#heard ? 'no alarms' : 'not known'));
    if (focused) list.querySelector(`[data-alarm="${CSS.escape(focused)}"] button`)?.focus();
  }

  #row(alarm) {
    const state = open(alarm) ? (lasting(alarm) ? 'open' : 'open ended') : 'done';
    const said = alarm.acknowledged_by
      ? `acknowledged by ${alarm.acknowledged_by}, ${clock(seconds(alarm.acknowledged_utc))}${alarm.note ? `: ${alarm.note}` : ''}`
      : lasting(alarm) ? 'lasts' : `ended ${clock(seconds(alarm.end_utc))}`;
    return element('li', { class: state, 'data-alarm': alarm.alarm_id },
      element('button', { type: 'button', class: 'plain', title: `${dateClock(seconds(alarm.start_utc))} UTC: ${text(alarm.evidence)}`, onclick: () => this.#select(alarm) },
        element('span', {}, element('strong', {}, words(alarm)), ` ${clock(seconds(alarm.start_utc))} – ${said}`),
        alarm.evidence && element('span', { class: 'soft' }, text(alarm.evidence))),
      open(alarm) && element('button', { type: 'button', class: 'acknowledge', onclick: () => this.acknowledge(alarm) }, 'Acknowledge'));
  }

  /** The alarms that the filters of the drawer show. */
  #chosen() {
    const [kind, zone] = [byId('alarm-kind').value, byId('alarm-zone').value];
    return this.rows.filter((alarm) => (!kind || alarm.kind === kind) && (!zone || zoneOf(alarm) === zone));
  }

  #zoneName(number) {
    const zone = this.app.zones?.found?.features.find(({ properties }) => String(properties.number) === number);
    return zone?.properties.name ?? `zone ${number}`;
  }

  #select(alarm) {
    if (alarm) this.app.select(alarm.vessel_id, { show: true, place: alarm });
  }

  acknowledgeFirst() {
    const first = this.first();
    if (first) this.acknowledge(first);
  }

  /** The name of the watch; without one it asks for it. */
  #name() {
    const name = byId('watch-name').value.trim();
    if (!name) {
      this.app.openDrawer('alarms');
      byId('watch-name').focus();
      this.app.say('Give your name: an alarm is acknowledged with it.');
    }
    return name;
  }

  #note() {
    return byId('alarm-note').value.trim();
  }

  /** Acknowledges every alarm that the list shows, in one request. None that began since is acknowledged with them. */
  async acknowledgeShown() {
    const alarms = this.#chosen().filter(open).sort((a, b) => seconds(a.start_utc) - seconds(b.start_utc));
    const name = alarms.length ? this.#name() : '';
    if (!name || !confirm(`Acknowledge ${alarms.length} alarms as ${name}?`)) return;
    const chosen = { kind: byId('alarm-kind').value || null, zone: Number(byId('alarm-zone').value) || null };
    try {
      const { acknowledged } = await postJson('alarms/acknowledge', {
        name, note: this.#note(), ...chosen, from: alarms[0].start_utc, to: alarms.at(-1).start_utc,
      });
      this.#changes++;
      byId('alarm-note').value = '';
      this.app.say(`Acknowledged: ${acknowledged} alarms.`);
    } catch (error) {
      this.app.say(`Not acknowledged: ${error.message}`);
    }
    await this.load();
  }

  /** Acknowledges one alarm with the name of the watch. */
  async acknowledge(alarm) {
    const name = this.#name();
    if (!name) return;
    try {
      const row = await postJson(`alarms/${encodeURIComponent(alarm.alarm_id)}/acknowledge`, { name, note: this.#note() });
      byId('alarm-note').value = '';
      this.#changes++;
      this.#take(this.rows.map((other) => (other.alarm_id === row.alarm_id ? { ...other, ...row } : other)));
      this.app.say(`Acknowledged: ${words(alarm)}.`);
    } catch (error) {
      this.app.say(`Not acknowledged: ${error.message}`);
    }
  }
}

const words = (alarm) => `${alarm.kind.replaceAll('_', ' ')}, ${label(alarm.vessel_id, alarm)}`;
