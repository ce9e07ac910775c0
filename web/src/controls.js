// Layers, filters, theme and keys: everything by which an operator changes what is shown.

import { byId, element, fill } from './dom.js';
import { filterWords, NO_FILTER } from './filters.js';
import { CLASSES } from './formats.js';
import { LAYERS, SPEEDS, THEME_NAMES, VECTOR_MINUTES } from './state.js';
import { css, THEMES } from './symbols.js';
import { keepView, showView } from './views.js';

const LAYER_NAMES = {
  labels: 'Names', vectors: 'Course vectors', outlines: 'Outlines by radar', ellipses: 'Ellipses (2σ)', trail: 'Trail, bearings of the selected',
  cover: 'Sensors and their range', zones: 'Zones', video: 'Radar video',
};

const VIDEO = ['gain', 'afterglow'];

/** Fills the drawer of layers and filters and keeps it in step with the state. */
export function makeControls(app) {
  const { state } = app;
  const option = (value, text, chosen) => element('option', { value, selected: value === chosen }, text);
  fill(byId('theme'), THEME_NAMES.map((name) => option(name, name, state.theme)));
  byId('theme').addEventListener('change', (event) => {
    state.theme = event.target.value;
    app.themeChanged();
  });
  fill(byId('speed'), SPEEDS.map((speed) => option(speed, `${speed}×`, state.speed)));
  fill(byId('layers'), LAYERS.map((name) => element('label', {},
    element('input', { type: 'checkbox', name, checked: state.layers.has(name), onchange: (event) => {
      if (event.target.checked) state.layers.add(name);
      else state.layers.delete(name);
      app.layersChanged();
    } }), LAYER_NAMES[name])));
  fill(byId('minutes'), VECTOR_MINUTES.map((minutes) => option(minutes, `${minutes} min`, state.minutes)));
  byId('minutes').addEventListener('change', (event) => {
    state.minutes = Number(event.target.value);
    app.layersChanged();
  });
  for (const name of VIDEO) {
    byId(name).value = state[name];
    byId(name).addEventListener('input', (event) => {
      state[name] = event.target.valueAsNumber;
      app.layersChanged();
    });
  }
  fill(byId('filter-type'), option('', 'all', state.filter.type), CLASSES.map((name) => option(name, name, state.filter.type)));
  showFilter(state.filter);
  byId('filters').addEventListener('input', () => {
    state.filter = readFilter();
    app.filterChanged();
  });
  byId('no-filter').addEventListener('click', () => {
    state.filter = { ...NO_FILTER };
    showFilter(state.filter);
    app.filterChanged();
  });
}

/** Brings the controls into step with the state. */
export function showControls(state) {
  byId('theme').value = state.theme;
  byId('minutes').value = state.minutes;
  for (const name of VIDEO) byId(name).value = state[name];
  for (const box of byId('layers').querySelectorAll('input')) box.checked = state.layers.has(box.name);
  showFilter(state.filter);
}

const bits = [['filter-ais', 1], ['filter-radar', 2], ['filter-bearing', 4]];
const limits = [['filter-minsog', 'minSog', 0], ['filter-maxsog', 'maxSog', Infinity], ['filter-maxage', 'maxAge', Infinity],
  ['filter-minlength', 'minLength', 0]];

function showFilter(filter) {
  for (const [id, bit] of bits) byId(id).checked = (filter.kinds & bit) !== 0;
  byId('filter-flagged').checked = filter.flagged;
  byId('filter-type').value = filter.type;
  for (const [id, name, none] of limits) byId(id).value = filter[name] === none ? '' : filter[name];
}

function readFilter() {
  const filter = { ...NO_FILTER, kinds: 0, flagged: byId('filter-flagged').checked, type: byId('filter-type').value };
  for (const [id, bit] of bits) if (byId(id).checked) filter.kinds |= bit;
  for (const [id, name, none] of limits) {
    const value = byId(id).valueAsNumber;
    filter[name] = value >= 0 ? value : none;
  }
  return filter;
}

/** The line over the chart that says what the filter hides. */
export function showFilterWords(filter, hidden) {
  const words = filterWords(filter);
  byId('filter-words').hidden = words.length === 0;
  byId('filter-words').textContent = `Filter: ${words.join(', ')} – ${hidden} hidden`;
}

/** Colours of a theme as variables of the style sheet. */
export function paintPage(name) {
  const root = document.documentElement;
  root.dataset.theme = name;
  root.style.colorScheme = name === 'day' ? 'light' : 'dark';
  for (const [colour, value] of Object.entries(THEMES[name])) root.style.setProperty(`--${colour}`, css(value));
}

/**
 * Whether a key is for the element that has the focus: what is typed into a field, and Space and Enter of a button. A slider
 * has only its arrows, which are no keys of the page.
 * @param {{tagName: string, type?: string}|null} control the nearest field, button or link; null: there is none
 */
export function takesKey(control, key) {
  if (!control || (control.tagName === 'INPUT' && control.type === 'range')) return false;
  const isPressed = ['BUTTON', 'SUMMARY', 'A'].includes(control.tagName) || (control.tagName === 'INPUT' && control.type === 'checkbox');
  return !isPressed || key === ' ' || key === 'Enter';
}

/** Keys that work anywhere but in a field. */
export function listenToKeys(app) {
  const keys = {
    '/': () => {
      byId('search').focus();
      byId('search').select(); // what is typed replaces the last search
    },
    t: () => {
      app.openDrawer(app.state.drawer === 'vessels' ? '' : 'vessels');
      if (app.state.drawer) byId('list-scroll').focus(); // arrows then select
    },
    f: () => app.follow(!app.state.follow),
    l: () => app.replay.leave(),
    a: () => app.alarms.acknowledgeFirst(),
    m: () => app.toggleMeasure(),
    c: () => app.compare(),
    enter: () => app.takeCentre(),
    backspace: () => app.zones.undo(),
    n: () => app.nextAlarm(),
    ' ': () => app.replay.play(!app.replay.playing),
    '?': () => byId('help').showModal(),
    '+': () => app.map.zoomIn(),
    '=': () => app.map.zoomIn(),
    '-': () => app.map.zoomOut(),
    Escape: () => app.escape(),
  };
  const pan = { ArrowLeft: [-120, 0], ArrowRight: [120, 0], ArrowUp: [0, -120], ArrowDown: [0, 120] };
  document.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
    // Until the next drawing, keys still go to the button of a dialog that has just been closed.
    const target = event.target.closest('dialog:not([open])') ? document.body : event.target;
    if (target.closest('dialog') || takesKey(target.closest('input, select, textarea, button, summary, a'), event.key)) return;
    const digit = /^Digit([1-9])$/.exec(event.code); // with Shift its character depends on the keyboard
    if (digit) {
      event.preventDefault();
      (event.shiftKey ? keepView : showView)(app, Number(digit[1]));
      return;
    }
    if (pan[event.key] && target === document.body) {
      app.follow(false); // as dragging does: the next picture would take the chart back
      app.map.panBy(pan[event.key], {}, { byKeys: true });
    }
    const act = keys[event.key] ?? keys[event.key.toLowerCase()];
    if (!act || (target === app.map.getCanvas() && '+=-'.includes(event.key))) return; // the map has its own keys for these
    event.preventDefault();
    act();
  });
}
