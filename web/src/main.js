// The page of the watch: puts the picture, the map, the list, the panel, the alarms and the time slider together.
// Reading order of the folder: README.md.

import { Alarms } from './alarms.js';
import { ofVessel, open as waits } from './alarm_book.js';
import { Details, getJson, MOST_KEPT, openSession } from './api.js';
import { drawEveryMs, drawsInSoftware, keepLand, loadCoastline, makeMap, paintChart, sizeAt } from './chart.js';
import { listenToKeys, makeControls, paintPage, showControls, showFilterWords } from './controls.js';
import { byId, element, fill } from './dom.js';
import { markShown, needsDetails } from './filters.js';
import { clock as clockText, seconds } from './formats.js';
import { badgeOf, sinceWords, troublesOf, troubleWords } from './health.js';
import { VesselList, Search } from './list.js';
import { follow as followLive } from './live.js';
import { Marks } from './marks.js';
import { Panel } from './panel.js';
import { PointsLayer } from './points.js';
import { Replay } from './replay.js';
import { DRAWERS, fromQuery, toQuery } from './state.js';
import { STROKE_PX, THEMES } from './symbols.js';
import { Video } from './video.js';
import { Picture, secondsOf } from './wire.js';
import { Zones } from './zones.js';

const STATUS_EVERY_MS = 3000;
const STATUS_WAIT_MS = 10000; // for an answer
const SENSORS_EVERY_MS = 15000;
const FLASH_MS = 600;
const AHEAD_CYCLES = 3; // for so long vessels are moved on without a picture
const SOFTWARE_PIXELS = 0.6; // of a CSS pixel: without a GPU every pixel costs processor time

class App {
  state = fromQuery(location.search);
  live = new Picture();
  status = null;
  sensors = [];
  troubles = []; // what is wrong, the serious first
  second = 0; // id of the vessel to which range and closest approach are shown
  measure = null; // {from, to} while measuring
  shown = new Uint8Array(0);
  stats = { frames: 0, bytes: 0, decode_ms: 0, refused: [] }; // read by tests and by the programs of scaling/
  #heardAt = 0; // performance.now() of the newest frame of the socket
  #socket = 'lost';
  #statusAt = -Infinity; // performance.now() of the last status
  #statusError = ''; // why there is no newer one
  #serious = new Set(); // keys of the troubles that were said
  #listed = ''; // the troubles in the list
  #redraw = null;
  #address = null;

  get replaying() {
    return this.replay !== undefined && this.replay.at !== null;
  }

  /** The picture on the screen: live, or of the replay. */
  get picture() {
    return this.replaying ? this.replay.picture : this.live;
  }

  /** Unix seconds to which vessels are moved on. */
  clock() {
    if (this.replaying) return this.replay.now();
    if (!this.live.at || this.status?.live === false) return this.live.at;
    const period = this.status?.period_s ?? 3;
    return this.live.at + Math.min((performance.now() - this.#heardAt) / 1000, AHEAD_CYCLES * period);
  }

  /** Unix seconds to which ages count: it goes on where the picture does not. */
  present() {
    if (this.replaying) return this.replay.now();
    if (!this.live.at || this.status?.live === false) return this.live.at;
    return this.live.at + (performance.now() - this.#heardAt) / 1000;
  }

  /** Seconds since a vessel of the picture was heard: by the picture, or by its details where they are newer. */
  heardAgo(slot, details) {
    const { picture } = this;
    const now = this.present();
    const told = seconds(details?.updated_utc);
    const sent = picture.epoch + picture.time[slot] - secondsOf(picture.age[slot]);
    return Math.max(0, now - (told > sent && told <= now ? told : sent));
  }

  theme() {
    return THEMES[this.state.theme];
  }

  async start() {
    paintPage(this.state.theme);
    const room = () => Math.max(MOST_KEPT, 2 * this.live.vessels);
    this.details = new Details(() => this.detailsChanged(), room, () => (this.replaying ? this.picture.at : null));
    await this.#look();
    this.map = makeMap(byId('map'), this.#firstView());
    this.points = new PointsLayer(() => this.clock());
    this.marks = new Marks(byId('marks'), this);
    this.panel = new Panel(this);
    this.list = new VesselList(this);
    this.search = new Search(this, async (query) => (await getJson(`vessels?q=${encodeURIComponent(query)}`)).vessels);
    this.alarms = new Alarms(this);
    this.replay = new Replay(this);
    this.zones = new Zones(this);
    this.video = new Video(this);
    makeControls(this);
    listenToKeys(this);
    this.#buttons();
    await new Promise((done) => { this.map.once('load', done); });
    this.#startMap();
    this.connection = followLive(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/api/v1/stream`, this.live, {
      frame: (changed, bytes, ms) => this.#frame(changed, bytes, ms),
      state: (name) => this.#socketIs(name),
      refused: (reason) => this.stats.refused.push(reason),
    });
    this.#poll();
    this.#loadSensors();
    this.zones.load();
    if (this.state.at !== null) this.replay.enter(this.state.at);
    if (this.state.selected) this.select(this.state.selected);
    this.openDrawer(this.state.drawer);
    setInterval(() => this.#second(), 1000);
  }

  /** The view of the address, else the area of the scenario, else all vessels once they have come. */
  #firstView() {
    const { lat, lon, zoom } = this.state;
    const area = this.status?.area;
    this.placed = (lat !== null && lon !== null && zoom !== null) || Boolean(area);
    if (lat !== null && lon !== null && zoom !== null) return { lat, lon, zoom };
    if (!area) return { lat: 50, lon: 0, zoom: 4 };
    const box = byId('map');
    const across = Math.max(area.width_nm / Math.cos((area.latitude_deg * Math.PI) / 180), 1) / 60 / 360;
    const fits = Math.min(box.clientWidth / across, (box.clientHeight * 60 * 360) / Math.max(area.height_nm, 1)
      * Math.cos((area.latitude_deg * Math.PI) / 180));
    return { lat: area.latitude_deg, lon: area.longitude_deg, zoom: Math.min(14, Math.log2(fits / 512)) };
  }

  /** Brings all vessels into sight. */
  #showAll() {
    const { live } = this;
    let [west, south, east, north] = [180, 90, -180, -90];
    for (const slot of live.slotOf.values()) {
      const [lat, lon] = [live.lat[slot] / 1e7, live.lon[slot] / 1e7];
      [west, south, east, north] = [Math.min(west, lon), Math.min(south, lat), Math.max(east, lon), Math.max(north, lat)];
    }
    if (west <= east) this.map.fitBounds([[west, south], [east, north]], { padding: 60, maxZoom: 12, animate: false });
  }

  #startMap() {
    const { map } = this;
    this.software = drawsInSoftware(map);
    if (this.software) map.setPixelRatio(SOFTWARE_PIXELS);
    this.points.setTheme(this.theme(), STROKE_PX[this.state.theme]);
    map.addLayer(this.video.layer, 'zones');
    map.addLayer(this.points);
    this.themeChanged();
    this.points.size = sizeAt(map);
    map.on('zoom', () => { this.points.size = sizeAt(map); });
    map.on('render', () => this.marks.draw());
    map.on('moveend', () => this.stateChanged());
    map.on('moveend', () => this.video.ask());
    map.on('move', ({ originalEvent, byKeys }) => { // panned by keys: the middle of the chart is then the other place
      if (!this.measure?.from || !(byKeys || originalEvent instanceof KeyboardEvent)) return;
      const { lat, lng } = map.getCenter().wrap();
      this.measure.to = { lat, lon: lng };
    });
    map.on('dragstart', () => this.follow(false));
    map.on('click', (event) => this.#click(event));
    map.on('dblclick', (event) => {
      if (!this.zones.drawing) return;
      event.preventDefault(); // no zoom
      this.zones.end();
    });
    map.on('mousemove', ({ lngLat }) => {
      if (!this.measure?.from) return;
      this.measure.to = { lat: lngLat.lat, lon: lngLat.lng };
      map.triggerRepaint();
    });
    const approximate = () => { byId('approximate').hidden = map.getZoom() < 7; };
    map.on('zoom', approximate);
    approximate();
    keepLand(map);
    if (this.status?.coastline !== false) loadCoastline(map); // a browser says every 404 in its console
    const animate = () => {
      if (!document.hidden && this.picture.vessels) map.triggerRepaint();
      setTimeout(animate, drawEveryMs(map, this.software));
    };
    animate();
    setInterval(() => {
      if (!this.alarms.flashing.size || matchMedia('(prefers-reduced-motion: reduce)').matches) {
        this.points.bright = true;
        return;
      }
      this.points.bright = !this.points.bright;
      map.triggerRepaint();
    }, FLASH_MS);
  }

  #buttons() {
    for (const name of DRAWERS) {
      byId(`open-${name}`).addEventListener('click', () => this.openDrawer(this.state.drawer === name ? '' : name));
    }
    byId('measure').addEventListener('click', () => this.toggleMeasure());
    byId('open-troubles').addEventListener('click', () => this.openTroubles(byId('trouble-rows').hidden));
    byId('open-help').addEventListener('click', () => byId('help').showModal());
    byId('close-help').addEventListener('click', () => byId('help').close());
    byId('token-form').addEventListener('submit', async (event) => {
      event.preventDefault();
      try {
        await openSession(byId('token').value);
        location.reload();
      } catch (error) {
        byId('token-error').textContent = error.message;
      }
    });
  }

  /** One message of the socket was taken. */
  #frame(changed, bytes, ms) {
    Object.assign(this.stats, { frames: this.stats.frames + 1, bytes, decode_ms: ms, seq: this.live.seq, run: this.live.run });
    if (changed < 0) return;
    this.#heardAt = performance.now();
    if (this.run !== this.live.run) {
      if (this.run !== undefined) this.forgetVessels();
      else if (!this.placed) this.#showAll();
      this.run = this.live.run;
      this.video.runChanged();
    }
    if (this.replay.at === null) this.pictureChanged();
  }

  #socketIs(name) {
    this.#socket = name;
    if (name === 'token' && !byId('login').open) byId('login').showModal();
    this.#badge();
  }

  /** Another picture, another filter or other alarms: what is shown is marked again, and everything drawn again. */
  pictureChanged() {
    const { picture } = this;
    if (needsDetails(this.state.filter)) this.allDetails();
    if (this.shown.length !== picture.id.length) this.shown = new Uint8Array(picture.id.length);
    this.count = markShown(picture, this.state.filter, this.details, this.shown);
    for (const id of this.replaying ? [] : this.alarms.flashing) { // alarms are of now
      const slot = picture.slotOf.get(id);
      if (slot === undefined) continue;
      this.count += this.shown[slot] ? 0 : 1;
      this.shown[slot] = 2;
    }
    this.points.show(picture, this.shown);
    showFilterWords(this.state.filter, picture.vessels - this.count);
    this.list.update();
    this.panel.update();
    this.#keepInSight();
    this.#badge();
    this.map.triggerRepaint();
  }

  detailsChanged() {
    if (needsDetails(this.state.filter)) this.pictureChanged();
    else this.list.update();
    this.panel.update();
    this.map.triggerRepaint();
  }

  alarmsChanged() {
    if (this.points.picture) this.pictureChanged();
  }

  /** Another run, or another time: its vessels may be others under the same ids. */
  forgetVessels() {
    this.details.clear();
    this.allAt = -Infinity;
  }

  /** Fetches the details of all vessels, once a minute at most. */
  async allDetails() {
    if (!this.picture.at) return; // that of a replay has not come
    if (performance.now() - (this.allAt ?? -Infinity) < 60000) return;
    this.allAt = performance.now();
    await this.details.all().catch((error) => this.say(error.message));
  }

  filterChanged() {
    this.pictureChanged();
    this.list.update(true);
    this.stateChanged();
  }

  layersChanged() {
    this.zones.show();
    this.video.update();
    this.stateChanged();
  }

  themeChanged() {
    paintPage(this.state.theme);
    paintChart(this.map, this.state.theme);
    this.points.setTheme(this.theme(), STROKE_PX[this.state.theme]);
    this.video.update();
    this.stateChanged();
  }

  /** A kept view was put into the state. */
  viewChanged() {
    const { lat, lon, zoom } = this.state;
    showControls(this.state);
    this.follow(false);
    if (zoom !== null) this.map.jumpTo({ center: [lon, lat], zoom });
    this.themeChanged();
    this.layersChanged();
    this.filterChanged();
  }

  /** Live or replay was chosen. */
  modeChanged() {
    this.pictureChanged();
    this.zones.show();
    this.video.update();
    this.alarms.update();
    this.panel.refresh();
    this.stateChanged();
  }

  /** Writes the state into the address once nothing has changed for a moment: browsers count and limit such writes. */
  stateChanged() {
    clearTimeout(this.#address);
    this.#address = setTimeout(() => {
      const { lat, lng } = this.map.getCenter().wrap();
      Object.assign(this.state, { lat, lon: lng, zoom: this.map.getZoom(), at: this.replay.at === null ? null : this.replay.now() });
      history.replaceState(null, '', `?${toQuery(this.state)}`);
    }, 400);
  }

  /**
   * Selects a vessel.
   * @param {number} id 0: none
   * @param {{show?: boolean, place?: {latitude_deg: number, longitude_deg: number}}} how show: bring it into sight
   */
  select(id, { show = false, place = null } = {}) {
    this.state.selected = id;
    if (!id) this.state.follow = false;
    if (this.second === id) this.second = 0;
    const slot = this.selectedSlot();
    if (id && show) {
      const [lat, lon] = slot >= 0 ? this.picture.position(slot, this.clock()) : [place?.latitude_deg, place?.longitude_deg];
      if (Number.isFinite(lat)) this.#bringIntoSight(lat, lon);
    }
    byId('vessel-region').setAttribute('aria-label', id ? `Vessel ${id}` : 'No vessel');
    this.panel.show(id);
    this.list.update();
    this.stateChanged();
    this.map.triggerRepaint();
  }

  #bringIntoSight(lat, lon) {
    const inside = this.map.getBounds().contains([lon, lat]);
    const zoom = Math.max(this.map.getZoom(), 9);
    if (!inside || zoom !== this.map.getZoom()) this.map.jumpTo({ center: [lon, lat], zoom });
  }

  selectedSlot() {
    return this.#slot(this.state.selected);
  }

  secondSlot() {
    return this.#slot(this.second);
  }

  #slot(id) {
    return id ? (this.picture.slotOf.get(id) ?? -1) : -1;
  }

  follow(on) {
    const follow = on && this.state.selected > 0;
    if (follow === this.state.follow) return;
    this.state.follow = follow;
    this.#keepInSight();
    this.panel.update();
    this.stateChanged();
  }

  #keepInSight() {
    const slot = this.selectedSlot();
    if (!this.state.follow || slot < 0) return;
    const [lat, lon] = this.picture.position(slot, this.clock());
    this.map.jumpTo({ center: [lon, lat] });
  }

  #click({ point, lngLat, originalEvent }) {
    if (this.zones.drawing || (this.measure && !this.measure.from)) {
      this.#takePoint(lngLat);
      return;
    }
    const slot = this.points.pick(point);
    const id = slot < 0 ? 0 : this.picture.id[slot];
    if (originalEvent.shiftKey && this.state.selected) {
      this.second = id === this.state.selected ? 0 : id;
      this.panel.update();
      this.map.triggerRepaint();
    } else {
      this.select(id);
    }
  }

  /** A place of the chart for what is being drawn or measured. */
  #takePoint({ lat, lng }) {
    if (this.zones.drawing) this.zones.point({ lat, lng });
    else this.measure.from = { lat, lon: lng };
    this.map.triggerRepaint();
  }

  /** Takes the middle of the chart as a click takes its place: drawing and measuring without a mouse. */
  takeCentre() {
    if (this.zones.drawing) this.zones.enter(this.map.getCenter().wrap());
    else if (this.awaitsPoint()) this.#takePoint(this.map.getCenter().wrap());
  }

  /** Whether a click on the chart is a point of a zone or the beginning of a measure. */
  awaitsPoint() {
    return this.zones.drawing || (this.measure !== null && !this.measure.from);
  }

  /** Keeps the selected vessel, so that the next one that is selected is compared with it. */
  compare() {
    const { selected } = this.state;
    if (!selected) this.say('Select a vessel first.');
    else {
      this.second = this.second ? 0 : selected;
      this.say(this.second ? 'Now select the other vessel: list (T), search (/) or click.' : 'No second vessel.');
    }
    this.panel.update();
    this.map.triggerRepaint();
  }

  /** The path of the selected vessel up to the time that is shown: corrected now, in replay as the watch saw it. */
  trail() {
    const now = this.clock();
    if (!this.state.selected) return [];
    return (this.replaying ? this.panel.history() : this.panel.corrected()).filter(({ at }) => at <= now);
  }

  /** Newest line of sight of each bearing track of the selected vessel, from its sensor. None that is older than a minute. */
  bearings() {
    if (!this.state.layers.has('trail') || !this.state.selected) return [];
    const seen = new Map(), now = this.clock();
    const rows = (this.panel.known?.bearing_associations ?? []).map((row) => ({ ...row, at: Date.parse(row.time_utc) / 1000 }));
    for (const row of rows.filter(({ at }) => at <= now + 1 && at > now - 60).sort((a, b) => b.at - a.at)) {
      const key = `${row.source} ${row.track_id}`;
      const sensor = this.sensors.find(({ kind, name }) => kind === 'bearing' && name === row.source);
      if (seen.has(key) || !sensor || row.bearing_deg === undefined) continue;
      seen.set(key, {
        lat: sensor.latitude_deg, lon: sensor.longitude_deg, bearing_deg: row.bearing_deg, range_m: sensor.range_m || 40000,
      });
    }
    return [...seen.values()];
  }

  toggleMeasure() {
    const slot = this.selectedSlot();
    const [lat, lon] = slot >= 0 ? this.picture.position(slot, this.clock()) : [];
    this.measure = this.measure ? null : { from: slot >= 0 ? { lat, lon } : null, to: null };
    byId('measure').setAttribute('aria-pressed', String(this.measure !== null));
    if (this.measure && slot < 0) this.say('Measure: click the first place, or move the cross there and press Enter.');
    else if (this.measure) this.say('Measure: point at the other place, or move the chart with the arrow keys.');
    this.map.triggerRepaint();
  }

  nextAlarm() {
    const found = this.alarms.rows.filter((alarm) => waits(alarm) && ofVessel(alarm));
    const at = found.findIndex((alarm) => alarm.vessel_id === this.state.selected);
    const next = found[(at + 1) % found.length];
    if (next) this.select(next.vessel_id, { show: true, place: next });
  }

  /** Closes one thing at a time. */
  escape() {
    if (this.zones.drawing) this.zones.clear();
    else if (!byId('trouble-rows').hidden) this.openTroubles(false);
    else if (this.measure) this.toggleMeasure();
    else if (this.second) this.second = 0;
    else if (this.state.selected) this.select(0);
    else this.openDrawer('');
  }

  /** Opens a drawer. Args: name: of DRAWERS, empty: closes it. */
  openDrawer(name) {
    this.state.drawer = name;
    byId('drawer').hidden = !name;
    for (const other of DRAWERS) {
      byId(`drawer-${other}`).hidden = other !== name;
      byId(`open-${other}`).setAttribute('aria-expanded', String(other === name));
    }
    if (document.activeElement?.closest('[hidden]')) document.activeElement.blur(); // else the next key still goes there
    this.map.resize();
    this.list.update(true);
    this.alarms.update();
    this.stateChanged();
  }

  /** A message for the operator, read aloud too. */
  say(words) {
    byId('message').textContent = words;
    clearTimeout(this.quiet);
    this.quiet = setTimeout(() => { byId('message').textContent = ''; }, 8000);
  }

  /** Opens or closes the list of what is wrong. */
  openTroubles(open) {
    byId('trouble-rows').hidden = !open;
    byId('open-troubles').setAttribute('aria-expanded', String(open));
  }

  /** What the page knows of the server and of its own connections. */
  #known() {
    const { status, sensors, replaying } = this;
    const waited = this.live.at ? (performance.now() - this.#heardAt) / 1000 : Infinity;
    return {
      status, statusError: this.#statusError, statusAge_s: (performance.now() - this.#statusAt) / 1000, socket: this.#socket,
      waited_s: waited, replaying, sensors, alarmsError: this.alarms?.failed ?? '',
    };
  }

  /** The badge: what the picture is, and how old; the line below it: what is wrong. */
  #badge() {
    const known = this.#known();
    this.troubles = troublesOf(known);
    const { is, words } = badgeOf(known, this.troubles);
    const badge = byId('badge');
    if (badge.dataset.is !== is) badge.dataset.is = is;
    if (badge.textContent !== words) badge.textContent = words;
    byId('chart').classList.toggle('late', is === 'late');
    this.#showTroubles();
    const at = this.clock();
    byId('clock').textContent = at ? `${clockText(at)} UTC` : '--:--:-- UTC';
  }

  #showTroubles() {
    const { troubles } = this;
    byId('troubles').hidden = !troubles.length;
    if (!troubles.length) this.openTroubles(false);
    byId('troubles').classList.toggle('serious', troubles.some(({ serious }) => serious));
    byId('trouble-count').textContent = troubles.length === 1 ? '1 trouble' : `${troubles.length} troubles`;
    const line = troubles.map(troubleWords).join(' · ');
    if (byId('trouble-text').textContent !== line) byId('trouble-text').textContent = line;
    const rows = troubles.map((trouble) => ({ ...trouble, since: sinceWords(trouble, Date.now() / 1000) }));
    if (this.#listed !== JSON.stringify(rows)) {
      this.#listed = JSON.stringify(rows);
      fill(byId('trouble-rows'), rows.map(({ title, text, since, serious }) => element('li', { class: serious ? 'serious' : '' },
        element('strong', {}, title || 'Trouble'), ` ${text} `, element('span', { class: 'soft' }, since))));
    }
    const serious = troubles.filter((trouble) => trouble.serious);
    const fresh = serious.filter(({ key }) => !this.#serious.has(key));
    this.#serious = new Set(serious.map(({ key }) => key));
    if (fresh.length) byId('shout').textContent = `Trouble: ${troubleWords(fresh[0])}`;
  }

  /** What changes each second without a picture: clock, badge, position of the selected vessel. */
  #second() {
    this.#badge();
    this.panel.update();
    this.video.tell();
  }

  /** Asks for the status. */
  async #look() {
    try {
      this.status = await getJson('status', { signal: AbortSignal.timeout(STATUS_WAIT_MS) });
      [this.#statusAt, this.#statusError] = [performance.now(), ''];
    } catch (error) {
      this.#statusError = error.status ? error.message : 'the server does not answer';
      if (error.status === 401 && !byId('login').open) byId('login').showModal();
    }
  }

  async #poll() {
    await this.#look();
    if (this.status && !this.#statusError) this.#showStatus();
    this.#badge();
    setTimeout(() => this.#poll(), STATUS_EVERY_MS);
  }

  #showStatus() {
    const kinds = this.status.by_kind ?? {};
    const sum = (test) => Object.entries(kinds).filter(([kind]) => test(Number(kind))).reduce((total, [, n]) => total + n, 0);
    fill(byId('counts'), `${this.status.vessels} vessels`, element('span', { class: 'soft' }, `: ${sum((kind) => (kind & 3) === 3)} fused, ${sum((kind) => (kind & 3) === 1)} AIS, `
      + `${sum((kind) => (kind & 3) === 2)} radar, ${sum((kind) => kind === 4)} bearing`));
    const { title, scenario } = this.status;
    byId('title').title = title || scenario || 'Coastwatch';
    fill(byId('title'), element('span', { class: 'long' }, byId('title').title), element('span', { class: 'short' }, scenario || 'Coastwatch'));
    byId('role').textContent = this.status.role ?? '';
    document.body.dataset.role = this.status.role ?? '';
    this.alarms.compare(this.status.alarms);
  }

  async #loadSensors() {
    try {
      this.sensors = (await getJson('sensors')).sensors;
      this.map.triggerRepaint();
      this.video.ask();
    } catch {
      // Asked again; the chart works without sensors.
    }
    setTimeout(() => this.#loadSensors(), SENSORS_EVERY_MS);
  }
}

window.coastwatch = new App();
window.coastwatch.start();
