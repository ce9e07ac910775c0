// Zones of the watch: the list, a form for their rules, and drawing them on the chart. The server watches them.

import { getJson, sendJson } from './api.js';
import { setDraft, setZones } from './chart.js';
import { byId, element, fill } from './dom.js';
import { definitionOf, draftOf, hintOf, NEEDED, NO_RULE, pointsOf, ruleWords } from './zone_shapes.js';

const LOOK_EVERY_MS = 15000;
const SAME_PX = 6;

export class Zones {
  found = null; // the FeatureCollection of the server
  drawing = false;
  #points = [];
  #byKey = false; // whether the newest point came from the keyboard
  #changed = null; // the zone that is changed, as it was shown; null: a new one

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
    const all = this.app.state.layers.has('zones') ? this.found : null;
    // A replay shows the zones of files, which a run has from its beginning: those of now may not have been drawn then.
    const features = all?.features.filter(({ properties }) => !this.app.replaying || properties.source !== 'stored');
    setZones(this.app.map, all && { ...all, features });
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

  /** A click on the chart while drawing. A second one at the same place, as of a double click, is no other point. */
  point({ lat, lng }, byKey = false) {
    if (this.#isLast({ lat, lng })) return;
    this.#byKey = byKey;
    if (byId('zone-kind').value === 'circle' && this.#points.length === 2) this.#points.pop();
    this.#points.push([lat, lng]);
    this.#draft();
  }

  /** Enter: takes a place that the chart was moved to, and else ends the shape. Args: centre of the chart. */
  enter(centre) {
    if (this.#points.length && (!this.#byKey || this.#isLast(centre))) this.end();
    else this.point(centre, true);
  }

  /** Ends the shape; it is then named and saved. */
  end() {
    if (this.#points.length < NEEDED[byId('zone-kind').value]) return;
    this.drawing = false;
    this.#draft();
    byId(byId('zone-name').value ? 'zone-save' : 'zone-name').focus();
  }

  /** Takes the last point away. */
  undo() {
    if (!this.drawing) return;
    this.#points.pop();
    this.#draft();
    this.app.map.getCanvas().focus();
  }

  /** Whether a place is the last point, within a few pixels. */
  #isLast({ lat, lng }) {
    if (!this.#points.length) return false;
    const [one, other] = [this.app.map.project([lng, lat]), this.app.map.project(this.#points.at(-1).toReversed())];
    return Math.hypot(one.x - other.x, one.y - other.y) < SAME_PX;
  }

  #draft() {
    const kind = byId('zone-kind').value;
    byId('zone-draw').setAttribute('aria-pressed', String(this.drawing));
    byId('zone-save').disabled = this.#points.length < NEEDED[kind];
    byId('zone-cancel').disabled = !this.drawing && !this.#changed && !this.#points.length;
    byId('zone-title').textContent = !this.#changed ? 'New zone' : 'Change a zone';
    byId('zone-hint').textContent = hintOf(kind, this.#points.length, this.drawing);
    for (const part of document.querySelectorAll('#zone-form [data-of]')) part.hidden = (part.dataset.of === 'line') !== (kind === 'line');
    setDraft(this.app.map, draftOf(kind, this.#points));
    this.app.map.triggerRepaint();
  }

  #edit(zone) {
    this.clear();
    this.#changed = zone;
    for (const name of ['name', 'kind', 'min_speed_kn', 'max_speed_kn', 'crossing']) byId(`zone-${name}`).value = zone[name] ?? '';
    byId('zone-dwell_min').value = zone.dwell_s ? zone.dwell_s / 60 : '';
    for (const name of ['enter', 'leave']) byId(`zone-${name}`).checked = zone[name];
    this.#points = pointsOf(zone);
    this.#draft();
  }

  /** Leaves what was begun. */
  clear() {
    this.#changed = null;
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
    const zone = definitionOf(form, this.#points);
    await this.#change(this.#changed ? 'PUT' : 'POST', this.#changed, zone, ruleWords(zone) === NO_RULE
      ? `Saved: ${form.name}. It has no rule, so it raises no alarm: Change gives it one.` : `Saved: ${form.name}.`);
  }

  #remove(zone) {
    if (confirm(`Delete the zone ${zone.name}?`)) this.#change('DELETE', zone, undefined, `Deleted: ${zone.name}.`);
  }

  /** Asks the server for a change of a zone as it was shown; null: of a new one. It refuses where others have changed it since. */
  async #change(method, zone, body, done) {
    try {
      await sendJson(method, zone ? `zones/${zone.number}` : 'zones', body, zone ? { 'If-Match': `"${zone.version}"` } : {});
      this.clear();
      this.app.say(done);
    } catch (error) {
      this.app.say(`Not done: ${error.message}`);
    }
    await this.load();
  }
}
