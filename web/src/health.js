// What is wrong with the watch, in one list and one badge: from the status of the server, its sensors and the connections of the page.

import { clock, dateClock, duration, seconds } from './formats.js';

const MISSED_CYCLES = 2; // then the picture counts as late
const STATUS_LATE_S = 10; // it is asked for each 3 s
const A_DAY_S = 86400;
const KINDS = { // of the server; a kind that is not here has no title
  store: 'Database', log: 'Database', behind: 'Late', restart: 'Run', feed: 'Feed', clock: 'Clock', tokens: 'Tokens', picture: 'Picture',
  certificate: 'Certificate', crowd: 'Crowd', zone: 'Zone', webhook: 'Web hook',
  sensor: 'Sensor', run: 'Run', alarms: 'Alarms', status: 'Server', connection: 'Connection',
};
const SILENT_KINDS = { radar: 'radar', ais: 'AIS receiver' }; // a sonar that hears no ship is silent too

/**
 * What the page knows of the server and of its own connections.
 * @typedef {object} Known
 * @property {object|null} status the last answer of /status
 * @property {string} statusError why there is no newer one; empty: there is
 * @property {number} statusAge_s how old the last answer is
 * @property {string} socket waiting, open, lost or token
 * @property {number} waited_s since the newest frame; Infinity: none has come
 * @property {boolean} replaying
 * @property {object[]} sensors rows of /sensors
 * @property {string} alarmsError why the alarms are not those of now; empty: they are
 */

/**
 * What is wrong, the serious first.
 * @param {Known} known
 * @returns {{key: string, title: string, text: string, since_s: number, serious: boolean}[]} since_s: Unix seconds, NaN: not known
 */
export function troublesOf({ status, statusError, statusAge_s: age, socket, waited_s: waited, sensors, alarmsError }) {
  const out = [];
  const add = (kind, name, text, serious, since = NaN) => out.push({
    key: `${kind} ${name} ${serious}`, title: [KINDS[kind], name].filter(Boolean).join(' '), text, since_s: since, serious,
  });
  const lost = socket !== 'open' && socket !== 'waiting';
  if (lost) add('connection', '', waited < Infinity ? `no picture has come for ${duration(waited)}` : 'there is no connection to the server', true);
  if (statusError && (!status || age > STATUS_LATE_S)) add('status', '', statusError, !status);
  for (const { kind, name, text, serious, since_utc: since } of status?.troubles ?? []) add(kind, name, text, serious, seconds(since));
  if (status?.error) add('run', '', status.error, true);
  else if (status?.live === false && ['died', 'failed'].includes(status.run_status)) add('run', '', RUN_WORDS[status.run_status], true);
  const runs = status?.live || status?.run_status === 'running';
  for (const { kind, name, health, heard_utc: heard } of runs ? sensors : []) {
    if (!(kind in SILENT_KINDS) || (health !== 'silent' && health !== 'never heard')) continue;
    add('sensor', name, health === 'silent' ? `this ${SILENT_KINDS[kind]} is silent` : `this ${SILENT_KINDS[kind]} has not been heard yet`, false, seconds(heard));
  }
  if (alarmsError) add('alarms', '', `not up to date: ${alarmsError}`, false);
  return out.sort((a, b) => b.serious - a.serious);
}

const RUN_WORDS = { died: 'the run has died: its process is gone', failed: 'the run has failed' };

/**
 * Live, degraded, late, lost, stored or replay: what the picture is, and how old.
 * @param {Known} known
 * @param {ReturnType<typeof troublesOf>} troubles
 * @returns {{is: 'live'|'degraded'|'late'|'stored'|'replay', words: string}}
 */
export function badgeOf({ status, socket, waited_s: waited, replaying }, troubles) {
  const has = waited < Infinity;
  const late = (words) => ({ is: 'late', words });
  if (replaying) return { is: 'replay', words: 'REPLAY' };
  if (socket === 'waiting' && !has) return late('NO PICTURE YET');
  if (socket !== 'open' && socket !== 'waiting') return late(has ? `NO CONNECTION  ${duration(waited)}` : 'NO CONNECTION');
  const count = troubles.length > 1 ? `${troubles.length} TROUBLES` : troubles.length ? '1 TROUBLE' : '';
  if (status?.error) return late(/ failed\b/.test(status.error) ? 'RUN FAILED' : / ended\b/.test(status.error) ? 'RUN ENDED' : 'NO NEW PICTURE');
  if (status?.live === false) {
    const dead = { died: 'RUN DIED', failed: 'RUN FAILED' }[status.run_status];
    return dead ? late(`STORED  ${dead}`) : { is: count ? 'degraded' : 'stored', words: count ? `STORED  ${count}` : 'STORED' };
  }
  const [serious] = status?.troubles?.filter((trouble) => trouble.serious) ?? [];
  if (serious) return late(seriousWords(serious, status));
  if (waited > MISSED_CYCLES * (status?.period_s ?? 3) + 1) return late(`LATE  ${duration(waited)}`);
  if (!status) return { is: 'degraded', words: 'STATE NOT KNOWN' };
  const lag = `LIVE  lag ${duration(status.age_s)}`;
  return count ? { is: 'degraded', words: `${lag}  ${count}` } : { is: 'live', words: lag };
}

/** The words of the badge for a serious trouble of the server. */
function seriousWords({ kind, since_utc: since }, status) {
  const lasted = since ? `  ${duration(seconds(status.server_utc) - seconds(since))}` : '';
  if (kind === 'feed') return `NO FEED${lasted}`;
  if (kind === 'behind') return `LATE  ${duration(status.late_s)}`;
  if (kind === 'picture') return `LATE  ${duration(status.age_s)}`;
  return `TROUBLE${lasted}`;
}

/** A trouble as one text. */
export const troubleWords = ({ title, text }) => (title ? `${title}: ${text}` : text);
/** Since when, as text: with the date where it is long ago. Args: now_s: Unix seconds. */
export function sinceWords({ since_s: since }, now) {
  if (Number.isNaN(since)) return '';
  return `since ${now - since < A_DAY_S ? clock(since) : dateClock(since)}`;
}
