// Zones of the watch: the list, a form for their rules, and drawing them on the chart. The server watches them.

import { getJson, sendJson } from './api.js';
import { setDraft, setZones } from './chart.js';
import { byId, element, fill } from './dom.js';
import { definitionOf, draftOf, hintOf, NEEDED, pointsOf, ruleWords } from './zone_shapes.js';

const LOOK_EVERY_MS = 15000;

export class Zones {
  found = null; // the FeatureCollection of the server
  drawing = false;
  #points = [];
  #number = null; // of the zone that is changed; null: a new one

  constructor(app) {
    this.app = app;
    byId('zone-draw').addEventListener('click', () => {
      this.draw();
      app.map.getCanvas().focus(); // where Enter takes a point
    });
    byId('zone-cancel').addEventListener('click', () => this.clear());
    byId('zone-kind').addEventListener('change', () => this.draw());
    byId('zone-form').addEventListener('submit', (event) => {
      event.preventDefault();
      this.#save();
    });
  }

  /** Asks for the zones now, and again later: others change them too. */
  async load() {
    clearTimeout(this.timer);
    try {
      this.found = await getJson('zones');
      this.show();
    } catch {
      // Asked again; the chart works without zones.
    }
    this.timer = setTimeout(() => this.load(), LOOK_EVERY_MS);
  }

  /** Draws the zones on the chart, if their layer is on, and in the list. */
  show() {
    setZones(this.app.map, this.app.state.layers.has('zones') ? this.found : null);
    this.app.map.triggerRepaint();
    const zones = (this.found?.features ?? []).map(({ properties }) => properties);
    fill(byId('zone-rows'), zones.length ? zones.map((zone) => this.#row(zone)) : element('li', { class: 'soft' }, 'no zones'));
  }

  #row(zone) {
    const own = zone.source === 'stored';
    return element('li', {}, element('strong', {}, zone.name), ' ',
      element('span', { class: 'soft' }, `${zone.kind}: ${ruleWords(zone)}${own ? '' : ' (of the scenario file)'}`),
      own && element('span', { class: 'operator' },
        element('button', { type: 'button', onclick: () => this.#edit(zone), 'aria-label': `Change ${zone.name}` }, 'Change'),
        element('button', { type: 'button', onclick: () => this.#remove(zone), 'aria-label': `Delete ${zone.name}` }, 'Delete')));
  }

  /** Begins to draw: the next clicks on the chart are points of the zone. */
  draw() {
    this.#points = [];
    this.drawing = true;
    this.#draft();
  }

  /** A click on the chart while drawing. */
  point({ lat, lng }) {
    if (byId('zone-kind').value === 'circle' && this.#points.length === 2) this.#points.pop();
    this.#points.push([lat, lng]);
    this.#draft();
  }

  #draft() {
    const kind = byId('zone-kind').value;
    byId('zone-draw').setAttribute('aria-pressed', String(this.drawing));
    byId('zone-save').disabled = this.#points.length < NEEDED[kind];
    byId('zone-cancel').disabled = !this.drawing && this.#number === null;
    byId('zone-title').textContent = this.#number === null ? 'New zone' : 'Change a zone';
    byId('zone-hint').textContent = hintOf(kind, this.#points.length, this.drawing);
    for (const part of document.querySelectorAll('#zone-form [data-of]')) part.hidden = (part.dataset.of === 'line') !== (kind === 'line');
    setDraft(this.app.map, draftOf(kind, this.#points));
    this.app.map.triggerRepaint();
  }

  #edit(zone) {
    this.clear();
    this.#number = zone.number;
    for (const name of ['name', 'kind', 'min_speed_kn', 'max_speed_kn', 'crossing']) byId(`zone-${name}`).value = zone[name] ?? '';
    byId('zone-dwell_min').value = zone.dwell_s ? zone.dwell_s / 60 : '';
    for (const name of ['enter', 'leave']) byId(`zone-${name}`).checked = zone[name];
    this.#points = pointsOf(zone);
    this.#draft();
  }

  /** Leaves what was begun. */
  clear() {
    this.#number = null;
    this.#points = [];
    this.drawing = false;
    byId('zone-form').reset();
    this.#draft();
  }

  async #save() {
    const number = (name) => byId(`zone-${name}`).valueAsNumber || null;
    const form = {
      name: byId('zone-name').value, kind: byId('zone-kind').value, crossing: byId('zone-crossing').value,
      enter: byId('zone-enter').checked, leave: byId('zone-leave').checked, dwell_s: 60 * number('dwell_min'),
      min_speed_kn: number('min_speed_kn'), max_speed_kn: number('max_speed_kn'),
    };
    const path = this.#number === null ? 'zones' : `zones/${this.#number}`;
    await this.#change(this.#number === null ? 'POST' : 'PUT', path, definitionOf(form, this.#points), `Saved: ${form.name}.`);
  }

  #remove(zone) {
    if (confirm(`Delete the zone ${zone.name}?`)) this.#change('DELETE', `zones/${zone.number}`, undefined, `Deleted: ${zone.name}.`);
  }

  async #change(method, path, body, done) {
    try {
      await sendJson(method, path, body);
      this.clear();
      this.app.say(done);
    } catch (error) {
      this.app.say(`Not done: ${error.message}`);
    }
    await this.load();
  }
}
