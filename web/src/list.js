// The list of vessels: sorted and filtered, with only the rows in sight as elements. Its order can be locked.

import { byId, element, fill } from './dom.js';
import { DETAIL_COLUMNS, listOrder } from './filters.js';
import { course, duration, label, shipClass, text } from './formats.js';
import { flagWords, sourceWords } from './symbols.js';

const ROW_PX = 26;
const COLUMNS = [
  ['name', 'Name'], ['mmsi', 'MMSI'], ['type', 'Type'], ['length', 'Length'], ['sog', 'Speed'], ['cog', 'Course'],
  ['source', 'Sources'], ['flags', 'Flags'], ['age', 'Heard'],
];

/** The list of vessels in the drawer. */
export class VesselList {
  order = new Uint32Array(0); // vessel ids
  locked = false;
  #first = -1;

  constructor(app) {
    this.app = app;
    this.body = byId('rows');
    this.scroller = byId('list-scroll');
    this.scroller.addEventListener('scroll', () => this.#rows());
    this.scroller.addEventListener('keydown', (event) => this.#key(event));
    new ResizeObserver(() => this.#rows()).observe(this.scroller);
    byId('lock').addEventListener('change', (event) => {
      this.locked = event.target.checked;
      if (!this.locked) this.update();
    });
    this.#heading();
  }

  /** The buttons that sort. */
  #heading() {
    const { sort } = this.app.state;
    fill(byId('list-head'), COLUMNS.map(([name, title]) => {
      const mine = sort.column === name;
      const direction = mine ? (sort.down ? 'descending' : 'ascending') : 'none';
      const button = element('button', { type: 'button', onclick: () => this.#sort(name) },
        title, mine && element('span', { 'aria-hidden': 'true' }, sort.down ? ' ▾' : ' ▴'));
      return element('div', { role: 'columnheader', class: `cell ${name}`, 'aria-sort': direction }, button);
    }));
  }

  async #sort(column) {
    const { state } = this.app;
    const down = state.sort.column === column ? !state.sort.down : ['flags', 'sog', 'length'].includes(column);
    state.sort = { column, down };
    this.#heading();
    byId(`list-head`).querySelector(`.${column} button`).focus();
    this.app.stateChanged();
    this.update(true);
    if (DETAIL_COLUMNS.includes(column)) await this.app.allDetails();
    this.update(true);
  }

  /** Sorts again, unless the order is locked or nobody looks. Args: forced: sort even where the list is locked. */
  update(forced = false) {
    if (this.app.state.drawer !== 'vessels') return;
    const { picture, shown, details, state } = this.app;
    if (forced || !this.locked || this.order.length === 0) this.order = listOrder(picture, shown, details, state.sort);
    const empty = this.order.length ? '' : picture.vessels ? 'The filter hides every vessel.' : 'There are no vessels in the picture.';
    byId('list-empty').textContent = empty;
    byId('list-empty').hidden = !empty;
    byId('list-count').textContent = `${this.order.length} of ${picture.vessels} vessels`;
    byId('list').setAttribute('aria-rowcount', String(this.order.length + 1));
    this.body.style.height = `${this.order.length * ROW_PX}px`;
    this.#rows(true);
  }

  /** Makes the rows that can be seen. */
  #rows(changed = false) {
    if (this.app.state.drawer !== 'vessels') return;
    const first = Math.max(0, Math.floor(this.scroller.scrollTop / ROW_PX) - 4);
    if (!changed && first === this.#first) return;
    this.#first = first;
    const count = Math.ceil(this.scroller.clientHeight / ROW_PX) + 8;
    const ids = this.order.subarray(first, first + count);
    this.app.details.need(ids);
    fill(this.body, [...ids].map((id, k) => this.#row(id, first + k)));
  }

  #row(id, at) {
    const { app } = this;
    const slot = app.picture.slotOf.get(id);
    const details = app.details.get(id);
    const vessel = slot === undefined ? null : app.picture.vessel(slot);
    const flags = vessel ? flagWords(vessel.flag) : ['gone'];
    const cells = {
      name: label(id, details),
      mmsi: text(details?.mmsi),
      type: text(shipClass(details?.ship_type)),
      length: details?.length_m ? `${Math.round(details.length_m)} m` : '–',
      sog: vessel && !Number.isNaN(vessel.sog) ? vessel.sog.toFixed(1) : '–',
      cog: vessel ? course(vessel.cog) : '–',
      source: vessel ? sourceWords(vessel.kind) : '–',
      flags: flags.join(', '),
      age: vessel ? duration(app.heardAgo(slot, details)) : '–',
    };
    const selected = id === app.state.selected;
    return element('div', {
      role: 'row', class: `row${selected ? ' selected' : ''}`, style: `top:${at * ROW_PX}px`, 'aria-rowindex': at + 2,
      'aria-selected': String(selected), 'data-id': id, onclick: () => app.select(id, { show: true }),
    }, COLUMNS.map(([name]) => element('div', { role: 'gridcell', class: `cell ${name}`, title: cells[name] }, cells[name])));
  }

  /** Up, down, page and Home, End move the selection. */
  #key(event) {
    const page = Math.max(1, Math.floor(this.scroller.clientHeight / ROW_PX) - 1);
    const now = this.order.indexOf(this.app.state.selected);
    const to = { ArrowDown: now + 1, ArrowUp: now - 1, PageDown: now + page, PageUp: now - page, Home: 0, End: Infinity }[event.key];
    if (to === undefined || this.order.length === 0) return;
    event.preventDefault();
    event.stopPropagation();
    const at = Math.min(this.order.length - 1, Math.max(0, to));
    const { scroller } = this;
    if (at * ROW_PX < scroller.scrollTop) scroller.scrollTop = at * ROW_PX;
    else if ((at + 1) * ROW_PX > scroller.scrollTop + scroller.clientHeight) {
      scroller.scrollTop = (at + 1) * ROW_PX - scroller.clientHeight;
    }
    this.app.select(this.order[at], { show: true });
    this.#rows(true);
  }
}

/** The field that searches names, call signs, MMSI and vessel numbers. The server answers; the best hits come first. */
export class Search {
  #asked = 0;
  #timer = null;
  #answered = ''; // the text of which `rows` are the hits
  #takeFirst = false; // Enter was pressed before the hits came

  constructor(app, find) {
    this.app = app;
    this.find = find;
    this.field = byId('search');
    this.hits = byId('hits');
    this.field.addEventListener('input', () => {
      clearTimeout(this.#timer);
      this.#takeFirst = false;
      this.#timer = setTimeout(() => this.#ask(), 200);
    });
    this.field.addEventListener('keydown', (event) => this.#key(event));
    this.field.addEventListener('blur', () => setTimeout(() => this.#close(), 200));
  }

  async #ask() {
    const query = this.field.value.trim();
    const mine = ++this.#asked;
    if (!query) return this.#close();
    let found;
    try {
      found = await this.find(query);
    } catch (error) {
      found = [];
      this.app.say(error.message);
    }
    if (mine !== this.#asked) return undefined;
    this.rows = found.slice(0, 12);
    this.at = this.rows.length ? 0 : -1;
    this.#answered = query;
    if (this.#takeFirst && this.rows.length) this.#take(0);
    else this.#show();
    this.#takeFirst = false;
    return undefined;
  }

  #show() {
    const options = this.rows.map((row, k) => element('li', {
      role: 'option', id: `hit-${k}`, 'aria-selected': String(k === this.at), onpointerdown: () => this.#take(k),
    }, element('strong', {}, label(row.vessel_id, row)),
    ` ${[row.mmsi, row.call_sign, shipClass(row.ship_type)].filter(Boolean).join(' · ')} #${row.vessel_id}`));
    fill(this.hits, options.length ? options : element('li', { role: 'option', 'aria-selected': 'false', 'aria-disabled': 'true' }, 'nothing found'));
    this.hits.hidden = false;
    this.field.setAttribute('aria-expanded', 'true');
    if (this.at >= 0) this.field.setAttribute('aria-activedescendant', `hit-${this.at}`);
    else this.field.removeAttribute('aria-activedescendant');
  }

  #close() {
    this.hits.hidden = true;
    this.rows = [];
    this.#answered = '';
    this.field.setAttribute('aria-expanded', 'false');
    this.field.removeAttribute('aria-activedescendant');
  }

  #take(k) {
    const row = this.rows?.[k];
    if (!row) return;
    this.app.details.set(row.vessel_id, { ...this.app.details.get(row.vessel_id), ...row });
    this.app.select(row.vessel_id, { show: true, place: row });
    this.#close();
    this.field.blur();
  }

  #key(event) {
    if (event.key === 'Enter' && this.field.value.trim() === this.#answered) this.#take(this.at);
    else if (event.key === 'Enter') {
      clearTimeout(this.#timer);
      this.#takeFirst = true;
      this.#ask();
    }
    else if (event.key === 'Escape') {
      this.field.value = '';
      this.#close();
      this.field.blur();
    } else if ((event.key === 'ArrowDown' || event.key === 'ArrowUp') && this.rows?.length) {
      event.preventDefault();
      this.at = (this.at + (event.key === 'ArrowDown' ? 1 : this.rows.length - 1)) % this.rows.length;
      this.#show();
    }
  }
}
