// The alarms of the run in memory, by their ids: the most urgent first, whatever else there is.

import { seconds } from './formats.js';

export const DISTRESS = 0;
const SUSPICION = 3; // of a server that says no priority
const MOST_DONE = 500; // ended and acknowledged ones that are kept

export const lasting = (alarm) => !alarm.end_utc;
export const open = (alarm) => !alarm.acknowledged_by;
export const priorityOf = (alarm) => alarm.priority ?? SUSPICION;
export const inDistress = (alarm) => priorityOf(alarm) === DISTRESS && lasting(alarm) && open(alarm);
/** Whether it is of a vessel; others are of a sensor, which their evidence names. */
export const ofVessel = (alarm) => alarm.vessel_id > 0;

/** Whether an alarm is over: it has ended, and somebody has acknowledged it. */
const done = (alarm) => !open(alarm) && !lasting(alarm);

/** Those that are over come last; the others by priority, then unacknowledged ones, then the newest. */
export function compared(a, b) {
  return done(a) - done(b) || (done(a) ? 0 : priorityOf(a) - priorityOf(b) || open(b) - open(a))
    || b.began_s - a.began_s || (a.alarm_id < b.alarm_id ? -1 : 1);
}

export class AlarmBook {
  #known = new Map(); // id to alarm
  #rows = null; // in order; null: something has changed

  /** Takes an alarm as it is now. Args: row: of the API. Returns: it. */
  take(row) {
    const alarm = { ...row, began_s: seconds(row.start_utc) };
    this.#known.set(row.alarm_id, alarm);
    this.#rows = null;
    return alarm;
  }

  get(id) {
    return this.#known.get(id);
  }

  /** All of them in order; the oldest of those that are over are forgotten where there are too many. */
  rows() {
    if (this.#rows) return this.#rows;
    const rows = [...this.#known.values()].sort(compared);
    const first = rows.findIndex(done);
    if (first >= 0) for (const { alarm_id: id } of rows.splice(first + MOST_DONE)) this.#known.delete(id);
    this.#rows = rows;
    return rows;
  }
}
