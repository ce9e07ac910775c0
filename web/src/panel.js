// The panel of the selected vessel: who it is, where it is, who sees it, and why the picture holds it for one vessel.

import { atOf, getJson } from './api.js';
import { byId, element, fill, pairs } from './dom.js';
import { clock, course, dateClock, duration, label, length, miles, position, seconds, shipClass, speed, text } from './formats.js';
import { closestApproach, rangeBearing } from './geodesy.js';
import { flagWords, sourceWords } from './symbols.js';
import { metresOf } from './wire.js';

const AGAIN_MS = 10000;
const ROWS = 8; // of a table of the reasons

export class Panel {
  known = null; // the answer of /vessels/ID
  #timer = null;

  constructor(app) {
    this.app = app;
    byId('close-panel').addEventListener('click', () => app.select(0));
    byId('follow').addEventListener('click', () => app.follow(!app.state.follow));
  }

  /** Shows a vessel, or none. Args: id: 0: none. */
  async show(id) {
    clearTimeout(this.#timer);
    byId('panel').hidden = !id;
    if (this.known?.vessel_id !== id) {
      this.known = null;
      fill(byId('why'));
    }
    this.update();
    if (id) await this.#load(id);
  }

  /** Fetches the vessel now and each ten seconds while it is selected. */
  async #load(id) {
    try {
      const { at } = this.app.replay; // a run of the past may have had another vessel of this number
      const known = await getJson(`vessels/${id}${atOf(at, '?')}`);
      if (this.app.state.selected !== id) return;
      this.known = known;
      this.app.details.set(id, { ...this.app.details.get(id), ...known });
      this.refresh();
    } catch (error) {
      if (this.app.state.selected !== id) return;
      if (!this.known) fill(byId('why'), element('p', {}, error.status === 404 ? `Vessel ${id} is not in this run.` : error.message));
    }
    this.update();
    this.#timer = setTimeout(() => this.#load(id), AGAIN_MS);
  }

  /** The reasons for the time that is shown. */
  refresh() {
    if (this.known) fill(byId('why'), this.#reasons(this.known));
  }

  /** The figures that change with each picture. */
  update() {
    const { app } = this;
    const id = app.state.selected;
    if (!id) return;
    const slot = app.selectedSlot();
    const details = { ...this.known, ...app.details.get(id) };
    byId('vessel-name').textContent = label(id, details);
    byId('follow').setAttribute('aria-pressed', String(app.state.follow));
    const vessel = slot >= 0 ? app.picture.vessel(slot, app.clock()) : null;
    fill(byId('flags'), (vessel ? flagWords(vessel.flag) : ['not in this picture'])
      .map((word) => element('li', { class: word === 'alarm' ? 'grave' : '' }, word)));
    const size = details.length_m ? `${Math.round(details.length_m)} × ${details.beam_m ? Math.round(details.beam_m) : '–'} m` : '–';
    const byRadar = sizeWords(slot >= 0 ? app.picture.size(slot) : null);
    fill(byId('facts'), pairs([
      ['MMSI', text(details.mmsi)],
      lastAis(details) && ['Last AIS', lastAis(details)],
      ['Call sign', text(details.call_sign)],
      ['Type', shipClass(details.ship_type) || text(details.ship_type)],
      ['Length × beam', size],
      byRadar && ['By radar', byRadar],
      !app.replaying && ['Status', text(details.nav_status)], // of now: the past is not asked for
      vessel && ['Position', position(vessel.lat, vessel.lon)],
      vessel && ['Speed, course', `${speed(vessel.sog)}  ${course(vessel.cog)}`],
      vessel && ['Ellipse (2σ)', `${length(2 * metresOf(app.picture.major[slot]))} × ${length(2 * metresOf(app.picture.minor[slot]))}`],
      !app.replaying && details.alternative_m && ['In doubt', `may be ${length(details.alternative_m)} from there`],
      vessel && ['Sources', sourceWords(vessel.kind)],
      vessel && ['Heard', `${duration(app.heardAgo(slot, details))} ago`],
      details.since_utc && ['Known since', dateClock(seconds(details.since_utc))],
      ['Vessel number', String(id)],
    ]));
    this.#second(vessel);
  }

  /** Range, bearing and closest approach to the second vessel. */
  #second(own) {
    const { app } = this;
    const slot = app.secondSlot();
    if (!own || slot < 0) {
      fill(byId('second'));
      return;
    }
    const other = app.picture.vessel(slot, app.clock());
    const [range, bearing] = rangeBearing(own.lat, own.lon, other.lat, other.lon);
    const { distance_m: distance, time_s: time } = closestApproach(own, other);
    fill(byId('second'), element('h3', {}, `To ${label(other.id, app.details.get(other.id))}`), pairs([
      ['Range, bearing', `${miles(range)}  ${course(bearing)}`],
      ['CPA', miles(distance)],
      ['TCPA', time < 0 ? `passed ${duration(-time)} ago` : duration(time)],
    ]));
  }

  /** Tracks, statistics and method behind the vessel. */
  #reasons(known) {
    const until = this.app.replaying ? this.app.clock() : Infinity;
    const method = Object.values(known.method ?? {}).flatMap((settings) => Object.entries(settings ?? {}))
      .filter(([, value]) => value !== null && typeof value !== 'object');
    return [
      element('h3', {}, 'Why'),
      ...(known.events ?? []).filter((event) => lastsAt(event.start_utc, event.end_utc, until) && event.evidence)
        .map(({ kind, start_utc: from, evidence }) => element('p', {}, element('strong', {}, kind.replaceAll('_', ' ')),
          ` since ${clockOf(from)}: ${evidence}`)),
      table('Contributing tracks', known.members, [
        ['source', 'Source'], ['track_id', 'Track'], ['from_utc', 'From', clockOf], ['to_utc', 'To', clockOf],
      ], until, (row) => trackRank(row, until)),
      table('Associations', known.associations, [
        ['time_utc', 'Time', clockOf], ['first_source', 'First track', (source, row) => `${source} ${row.first_track}`],
        ['second_source', 'Second track', (source, row) => `${source} ${row.second_track}`], ['statistic', 'Statistic', number],
      ], until),
      known.associations?.length > 0 && known.statistics?.associations && element('p', { class: 'soft' }, known.statistics.associations),
      table('Bearings', known.bearing_associations, [
        ['time_utc', 'Time', clockOf], ['source', 'Source'], ['track_id', 'Track'], ['bearing_deg', 'Bearing', course],
        ['statistic', 'Statistic', number],
      ], until),
      method.length > 0 && element('details', {}, element('summary', {}, 'Method: window and threshold'),
        pairs(method.map(([name, value]) => [name.replaceAll('_', ' '), String(value)]))),
      table('Events', known.events, [
        ['kind', 'Kind', (kind) => kind.replaceAll('_', ' ')], ['start_utc', 'From', clockOf],
        ['end_utc', 'To', (utc) => (utc ? clockOf(utc) : 'lasts')],
      ], until),
      this.#speeds(known.history ?? []),
    ].filter(Boolean);
  }

  /** The speed of the past as a small graph. */
  #speeds(history) {
    const rows = history.filter((row) => row.sog_kn !== null).sort((a, b) => seconds(a.time_utc) - seconds(b.time_utc));
    if (rows.length < 2) return null;
    const [from, to] = [seconds(rows[0].time_utc), seconds(rows.at(-1).time_utc)];
    const top = Math.max(1, ...rows.map((row) => row.sog_kn));
    const points = rows.map((row) => `${((seconds(row.time_utc) - from) / (to - from || 1)) * 300},${46 - (row.sog_kn / top) * 42}`);
    const svg = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
    svg.setAttribute('viewBox', '0 0 300 48');
    svg.setAttribute('role', 'img');
    svg.setAttribute('aria-label', `Speed of the last ${duration(to - from)}, up to ${speed(top)}`);
    const line = document.createElementNS('http://www.w3.org/2000/svg', 'polyline');
    line.setAttribute('points', points.join(' '));
    svg.append(line);
    return element('figure', {}, element('figcaption', {}, `Speed, last ${duration(to - from)}, up to ${speed(top)}`), svg);
  }

  /** Stored positions of the vessel: Unix seconds, latitude, longitude; oldest first. */
  history() {
    return places(this.known?.history);
  }

  /** The same with the corrected past in the place of what the watch saw then. */
  corrected() {
    return correctedPath(this.history(), places(this.known?.decided));
  }
}

const places = (rows) => (rows ?? []).map((row) => ({ at: seconds(row.time_utc), lat: row.latitude_deg, lon: row.longitude_deg }))
  .sort((a, b) => a.at - b.at);

const CORRECTED_S = 30; // a stored position goes where a decided state is of the same stretch of so many seconds

/** A path in which decided states replace stored positions of about their time. Both: Unix seconds, latitude, longitude; oldest first. */
export function correctedPath(history, decided) {
  const stretch = ({ at }) => Math.floor(at / CORRECTED_S);
  const known = new Set(decided.map(stretch));
  return [...history.filter((point) => !known.has(stretch(point))), ...decided].sort((a, b) => a.at - b.at);
}

const clockOf = (utc) => (utc ? clock(seconds(utc)) : '–');
const number = (value) => (value === null || value === undefined ? '–' : Number(value.toPrecision(4)).toString());

/** The ship as which a vessel sent AIS before, which it may not be any more: SALTY DOG (710000001), until 12:03:04; empty: none. */
export function lastAis({ last_ais_name: name, last_ais_mmsi: mmsi, last_ais_until_utc: until }) {
  const who = name && mmsi ? `${name} (${mmsi})` : name || mmsi;
  return who ? `${who}${until ? `, until ${clock(seconds(until))}` : ''}` : '';
}

/** Whether something lasts at a time; an end after that time is not known yet. Args: until: Unix seconds. */
export const lastsAt = (from, to, until) => !(seconds(from) > until) && (!to || seconds(to) > until);

/** Tracks that last before those that have ended, and of these radar and AIS before bearings. Args: until: Unix seconds. */
export const trackRank = (row, until) => (lastsAt(row.from_utc, row.to_utc, until) ? 0 : 2) + (row.kind === 'bearing' ? 1 : 0);

/**
 * The newest rows of a table up to a time; null where there are none.
 * @param {[string, string, Function?][]} columns name, title, format
 * @param {number} until Unix seconds
 * @param {(row: object) => number} rank of a row; those with the lowest come first
 */
function table(title, all, columns, until, rank = () => 0) {
  const time = columns.map(([name]) => name).find((name) => name.endsWith('_utc'));
  const rows = (all ?? []).filter((row) => !(seconds(row[time]) > until));
  if (!rows.length) return null;
  const shown = rows.toSorted((a, b) => rank(a) - rank(b) || seconds(b[time]) - seconds(a[time])).slice(0, ROWS);
  return element('table', {},
    element('caption', {}, rows.length > ROWS ? `${title} (${ROWS} of ${rows.length})` : title),
    element('thead', {}, element('tr', {}, columns.map(([, name]) => element('th', { scope: 'col' }, name)))),
    element('tbody', {}, shown.map((row) => element('tr', {}, columns.map(([name, , format = text]) => element('td', {}, format(row[name], row)))))));
}

/** Size and direction by radar as text; empty: it has none. */
function sizeWords(size) {
  if (!size) return '';
  const width = Number.isNaN(size.width) ? '–' : Math.round(size.width);
  return `${Math.round(size.length)} × ${width} m  ${course(size.axis)}`;
}
