// Alarms: the line at the top, the list, and their acknowledgement with a name.
// The server finds alarms and streams each one as it begins and changes. Lists are asked for only where there is no stream.

import { AlarmBook, DISTRESS, inDistress, lasting, ofVessel, open, priorityOf } from './alarm_book.js';
import { getJson, postJson } from './api.js';
import { byId, element, fill } from './dom.js';
import { clock, dateClock, label, seconds, text } from './formats.js';

const DRAW_MS = 50; // many alarms that come at once are drawn together
const FIRST_WAIT_MS = 1000; // before a stream that was refused is opened again
const LONGEST_WAIT_MS = 8000;
const LOST_LOOKS = 3; // looks at the status that find changes of which the stream has told nothing
const PAGE = 10000; // rows of one answer
const ROW_PX = 46; // as in style.css
const NAME_KEY = 'coastwatch.name';

const zoneOf = ({ kind, subject }) => (/^(zone_|line_)/.test(kind) ? String(subject) : '');

export class Alarms {
  book = new AlarmBook();
  rows = []; // in order, the most urgent first
  flashing = new Set(); // vessel ids with a lasting alarm that nobody has acknowledged
  failed = 'the server has not answered yet'; // why the alarms are not those of now; empty: they are
  asked = 0; // lists that were asked for, as there was no stream; read by tests
  #elements = new Map(); // id to the alarm and the row that shows it
  #chosen = []; // rows that the filters of the drawer show
  #heard = null; // ids of the alarms of the last drawing; null: none yet, so that a new page does not shout
  #drawn = null; // timer of the next drawing
  #again = null; // timer of the next stream
  #wait = FIRST_WAIT_MS;
  #stream = null;
  #id = ''; // of the newest event of the stream
  #idBefore = ''; // at the look before
  #behind = 0; // looks in a row that found it behind

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
    this.scroller = byId('alarm-scroll');
    this.scroller.addEventListener('scroll', () => this.#drawRows());
    new ResizeObserver(() => this.#drawRows()).observe(this.scroller);
    this.listen();
  }

  /**
   * Takes alarms as they come. The browser resumes a stream that breaks; one that was refused, or stands still, is opened anew.
   * After the event `run` all alarms come anew: they take the place of the others once they are complete, which an id says;
   * distress is shown at once.
   */
  listen() {
    clearTimeout(this.#again);
    this.#stream?.close();
    const stream = new EventSource('./api/v1/alarms/stream');
    let filling = null;
    let complete = false;
    this.#stream = stream;
    stream.onopen = () => { if (complete) this.#says(''); };
    const take = (event) => {
      if (event.type === 'run') filling = new AlarmBook();
      else {
        this.#behind = 0; // a long list has no number before its end
        const alarm = (filling ?? this.book).take(JSON.parse(event.data));
        if (filling && inDistress(alarm)) { // it does not wait for thousands of others
          this.book.take(alarm);
          this.#drawSoon();
        }
      }
      this.#wait = FIRST_WAIT_MS;
      if (!event.lastEventId) return;
      this.#id = event.lastEventId;
      if (filling) this.book = filling;
      filling = null;
      complete = true;
      this.#says('');
      this.#drawSoon();
    };
    stream.addEventListener('run', take);
    stream.addEventListener('alarm', take);
    stream.onerror = () => {
      if (stream !== this.#stream) return;
      if (stream.readyState === EventSource.CLOSED) this.#openLater();
      else this.#says('the server does not answer');
    };
  }

  /** Asks for the list, as there is no stream, and opens another stream later. */
  #openLater() {
    this.#stream?.close();
    this.#stream = null;
    clearTimeout(this.#again);
    this.#again = setTimeout(() => this.listen(), this.#wait);
    this.#wait = Math.min(this.#wait * 2, LONGEST_WAIT_MS);
    this.#ask();
  }

  /**
   * Opens another stream where this one is behind the server: a network that is gone, or a proxy that holds events back, says nothing.
   * @param {{run: number, change: number}|undefined} newest of the status
   */
  compare(newest) {
    const [run, change] = this.#id.split('-').map(Number);
    const isBehind = newest && this.#stream && this.#id === this.#idBefore && (run !== newest.run || change < newest.change);
    this.#behind = isBehind ? this.#behind + 1 : 0;
    this.#idBefore = this.#id;
    if (this.#behind < LOST_LOOKS) return;
    this.#behind = 0;
    this.#says('the stream of alarms stands still');
    this.#openLater();
  }

  /** Takes every alarm that lasts or waits, from the list of the server. */
  async #ask() {
    this.asked++;
    try {
      const found = [];
      for (let total = 1; found.length < total;) {
        const page = await getJson(`alarms?state=waiting&limit=${PAGE}&offset=${found.length}`);
        total = page.total;
        found.push(...page.alarms);
        if (!page.alarms.length) break;
      }
      if (this.#stream && !this.failed) return; // it has told everything since
      this.book = new AlarmBook();
      for (const alarm of found) this.book.take(alarm);
      this.#says('');
      this.#changed();
    } catch (error) {
      if (!this.#stream || this.failed) this.#says(error.status ? error.message : 'the server does not answer');
    }
  }

  /** Says why the alarms are not those of now; empty: they are. */
  #says(why) {
    if (this.failed === why) return;
    this.failed = why;
    this.#drawSoon();
  }

  #drawSoon() {
    this.#drawn ??= setTimeout(() => this.#changed(), DRAW_MS);
  }

  /** The alarms have changed: draws them wherever they are shown. */
  #changed() {
    clearTimeout(this.#drawn);
    this.#drawn = null;
    this.rows = this.book.rows();
    this.flashing = new Set(this.rows.filter((alarm) => open(alarm) && lasting(alarm) && ofVessel(alarm)).map((alarm) => alarm.vessel_id));
    const fresh = this.#heard ? this.rows.filter((alarm) => open(alarm) && !this.#heard.has(alarm.alarm_id)) : [];
    if (this.#heard || !this.failed) this.#heard = new Set(this.rows.map((alarm) => alarm.alarm_id));
    if (fresh.length) {
      const more = fresh.length > 3 ? `, and ${fresh.length - 3} more` : '';
      byId('shout').textContent = `${fresh.slice(0, 3).map((alarm) => `Alarm: ${words(alarm)}`).join('. ')}${more}`;
    }
    this.app.alarmsChanged();
    this.update();
  }

  /** The most urgent alarm that nobody has acknowledged, then the newest. */
  first() {
    return this.rows.find(open);
  }

  /** How many alarms nobody has acknowledged. */
  count() {
    return this.rows.reduce((sum, alarm) => sum + (open(alarm) ? 1 : 0), 0);
  }

  /** Draws the line at the top and, where it is open, the list. */
  update() {
    const first = this.first();
    const waiting = this.count();
    byId('strip').hidden = !first;
    if (first) {
      const grave = priorityOf(first) === DISTRESS;
      byId('strip').classList.toggle('distress', grave);
      byId('strip-kind').textContent = grave ? 'Distress' : 'Alarm';
      const now = this.app.replaying ? 'Now: ' : '';
      byId('strip-text').textContent = `${now}${words(first)}, ${dateClock(first.began_s)}${lasting(first) ? '' : ', ended'}`;
      const others = this.rows.filter((alarm) => inDistress(alarm) && alarm !== first).length;
      byId('strip-count').textContent = waiting > 1 ? `1 of ${waiting} to acknowledge${others ? `, ${others} more in distress` : ''}` : '';
      byId('strip-show').hidden = !ofVessel(first);
    }
    byId('alarm-count').textContent = this.#heard ? String(waiting) : '–';
    byId('open-alarms').title = `${waiting} to acknowledge`;
    if (this.app.state.drawer !== 'alarms') return;
    const [kind, zone] = [byId('alarm-kind').value, byId('alarm-zone').value];
    options('alarm-kind', kind, this.rows.map((alarm) => alarm.kind), (name) => name.replaceAll('_', ' '));
    options('alarm-zone', zone, this.rows.map(zoneOf), (number) => this.#zoneName(number));
    const anchor = this.#anchor();
    this.#chosen = this.rows.filter((alarm) => (!kind || alarm.kind === kind) && (!zone || zoneOf(alarm) === zone));
    const here = this.#chosen.filter(open).length;
    const last = this.#chosen.filter((alarm) => open(alarm) && lasting(alarm)).length;
    const older = kind || zone ? 0 : (this.app.status?.alarms_forgotten ?? 0);
    const sum = here ? `${here} to acknowledge: ${last} lasting, ${here - last} ended` : 'Nothing to acknowledge.';
    byId('acknowledge-shown').disabled = here === 0;
    byId('acknowledge-shown').textContent = here ? `Acknowledge all ${here} shown` : 'Acknowledge all shown';
    byId('alarm-words').textContent = this.failed ? `Not up to date: ${this.failed}.`
      : `${sum}${older ? ` ${older} older ones that have ended are in the database only.` : ''}`;
    byId('alarm-rows').style.height = `${this.#chosen.length * ROW_PX}px`;
    if (anchor) this.scroller.scrollTop = Math.max(0, this.#chosen.indexOf(this.book.get(anchor.id)) * ROW_PX + anchor.past_px);
    this.#drawRows();
  }

  /** The row at the upper edge of a list that was scrolled: it stays there when others come before it. */
  #anchor() {
    const { scrollTop } = this.scroller;
    const top = this.#chosen[Math.floor(scrollTop / ROW_PX)];
    return scrollTop > 0 && top ? { id: top.alarm_id, past_px: scrollTop % ROW_PX } : null;
  }

  /** Makes the rows in sight, and the one that has the focus. Rows that are the same stay: somebody may be pressing a button. */
  #drawRows() {
    if (this.app.state.drawer !== 'alarms') return;
    const list = byId('alarm-rows');
    const rows = this.#chosen;
    const first = Math.max(0, Math.floor(this.scroller.scrollTop / ROW_PX) - 3);
    const count = Math.ceil(this.scroller.clientHeight / ROW_PX) + 6;
    const focused = list.contains(document.activeElement) ? document.activeElement : null;
    const id = focused?.closest('[data-alarm]')?.dataset.alarm;
    const at = new Set(Array.from({ length: Math.max(0, Math.min(count, rows.length - first)) }, (_, k) => first + k));
    const kept = id ? rows.findIndex((alarm) => alarm.alarm_id === id) : -1;
    if (kept >= 0) at.add(kept);
    const before = this.#elements;
    this.#elements = new Map();
    for (const k of [...at].sort((a, b) => a - b)) {
      const alarm = rows[k];
      const known = before.get(alarm.alarm_id);
      const made = known?.alarm === alarm ? known.row : this.#row(alarm);
      made.style.top = `${k * ROW_PX}px`;
      made.setAttribute('aria-posinset', String(k + 1));
      made.setAttribute('aria-setsize', String(rows.length));
      this.#elements.set(alarm.alarm_id, { alarm, row: made });
    }
    const wanted = [...this.#elements.values()].map(({ row }) => row);
    if (!rows.length) wanted.push(element('li', { class: 'soft' }, this.#heard ? 'no alarms' : 'not known'));
    for (const row of [...list.children]) if (!wanted.includes(row)) row.remove();
    wanted.forEach((row, k) => { if (list.children[k] !== row) list.insertBefore(row, list.children[k] ?? null); });
    if (!focused || list.contains(document.activeElement)) return;
    const row = list.querySelector(`[data-alarm="${CSS.escape(id ?? '')}"]`);
    (row?.querySelector(`.${focused.className}`) ?? row?.querySelector('button'))?.focus({ preventScroll: true });
  }

  #row(alarm) {
    const state = open(alarm) ? (lasting(alarm) ? 'open' : 'open ended') : 'done';
    const said = alarm.acknowledged_by
      ? `acknowledged by ${alarm.acknowledged_by}, ${clock(seconds(alarm.acknowledged_utc))}${alarm.note ? `: ${alarm.note}` : ''}`
      : lasting(alarm) ? 'lasts' : `ended ${clock(seconds(alarm.end_utc))}`;
    const title = `${dateClock(alarm.began_s)} UTC: ${text(alarm.evidence)}`;
    const what = [
      element('span', {}, element('strong', {}, name(alarm)), ` ${clock(alarm.began_s)} – ${said}`),
      alarm.evidence && element('span', { class: 'soft' }, text(alarm.evidence)),
    ];
    return element('li', {
      class: `${state}${inDistress(alarm) ? ' distress' : ''}`, 'data-alarm': alarm.alarm_id,
    },
    ofVessel(alarm) ? element('button', { type: 'button', class: 'plain', title, onclick: () => this.#select(alarm) }, what)
      : element('div', { class: 'plain', title }, what),
    open(alarm) && element('button', { type: 'button', class: 'acknowledge', onclick: () => this.acknowledge(alarm) }, 'Acknowledge'));
  }

  #zoneName(number) {
    const zone = this.app.zones?.found?.features.find(({ properties }) => String(properties.number) === number);
    return zone?.properties.name ?? `zone ${number}`;
  }

  #select(alarm) {
    if (alarm && ofVessel(alarm)) this.app.select(alarm.vessel_id, { show: true, place: alarm });
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

  /** Acknowledges every alarm that the filters show, in one request. None that began since is acknowledged with them. */
  async acknowledgeShown() {
    const alarms = this.#chosen.filter(open).sort((a, b) => a.began_s - b.began_s);
    const name = alarms.length ? this.#name() : '';
    if (!name || !confirm(`Acknowledge ${alarms.length} alarms as ${name}?`)) return;
    const chosen = { kind: byId('alarm-kind').value || null, zone: Number(byId('alarm-zone').value) || null };
    try {
      const { acknowledged } = await postJson('alarms/acknowledge', {
        name, note: this.#note(), ...chosen, from: alarms[0].start_utc, to: alarms.at(-1).start_utc,
      });
      byId('alarm-note').value = '';
      this.app.say(`Acknowledged: ${acknowledged} alarms.`);
    } catch (error) {
      this.app.say(`Not acknowledged: ${error.message}`);
    }
    if (this.failed) await this.#ask(); // else the stream tells it
  }

  /** Acknowledges one alarm with the name of the watch. */
  async acknowledge(alarm) {
    const name = this.#name();
    if (!name) return;
    try {
      const row = await postJson(`alarms/${encodeURIComponent(alarm.alarm_id)}/acknowledge`, { name, note: this.#note() });
      byId('alarm-note').value = '';
      const { acknowledged_by, acknowledged_utc, note } = row; // the stream may have told more of it since
      this.book.take({ ...(this.book.get(row.alarm_id) ?? row), acknowledged_by, acknowledged_utc, note });
      this.#changed();
      this.app.say(`Acknowledged: ${words(alarm)}.`);
    } catch (error) {
      this.app.say(`Not acknowledged: ${error.message}`);
    }
  }
}

/** Fills a list of choices, unless it has just these: one that is open would close. */
function options(id, chosen, values, title) {
  const list = byId(id);
  const all = [...new Set([...values, chosen])].filter(Boolean).sort().map((value) => [value, title(value)]);
  const key = JSON.stringify(all);
  if (list.dataset.of === key) return;
  list.dataset.of = key;
  fill(list, element('option', { value: '' }, 'all'),
    all.map(([value, words]) => element('option', { value, selected: value === chosen }, words)));
}

const name = (alarm) => `${alarm.kind.replaceAll('_', ' ')}${ofVessel(alarm) ? `, ${label(alarm.vessel_id, alarm)}` : ''}`;
/** An alarm in one line; one without a vessel by its evidence. */
const words = (alarm) => (ofVessel(alarm) || !alarm.evidence ? name(alarm) : `${name(alarm)}: ${alarm.evidence}`);
