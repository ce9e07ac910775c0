-- Alarms: flags of vessels, zones, close approaches, dragging anchors, lost vessels and silent sensors
-- Latest first, also of vessels that have left. Each is from when until when it held; no end: until now. One that returned
-- within `store.event_gap_s` is one alarm, and `gaps` counts how often it returned. Position, speed and evidence are of the
-- start. `subject` is the number of the zone or sensor, or the id of the other vessel of a close approach; 0: none. Vessel 0:
-- the alarm is of a sensor.
-- parameter: from_s = 0.0, alarms that lasted at this instant or later, seconds since 1970 UTC (option --from takes UTC)
-- parameter: to_s = 253402300800.0, alarms that began at this instant or earlier (option --to takes UTC)
-- parameter: kind = alarms, a kind such as dark or zone_enter (option --kind); alarms: every kind
-- parameter: count = 1000, how many at most
WITH latest AS (
    SELECT max(time_s) AS time_s FROM cycle WHERE run_id = :run
)
SELECT e.vessel_id, e.kind, e.subject, e.start_s, e.end_s, coalesce(e.end_s, l.time_s) - e.start_s AS lasted_s, (
        SELECT count(*) FROM event_gap g
        WHERE g.run_id = e.run_id AND g.vessel_id = e.vessel_id AND g.kind = e.kind AND g.subject = e.subject
            AND g.from_cycle = e.from_cycle
    ) AS gaps, e.mmsi, s.name, e.latitude_deg, e.longitude_deg, e.sog_kn, e.evidence
FROM latest l
    CROSS JOIN event e
    LEFT JOIN vessel_static s ON s.run_id = e.run_id AND s.mmsi = e.mmsi
WHERE e.run_id = :run AND e.start_s <= :to_s AND (e.end_s IS NULL OR e.end_s >= :from_s)
    AND (e.kind = :kind OR (:kind = 'alarms' AND e.kind NOT IN ('coasting', 'stationary')))
ORDER BY e.start_s DESC, e.vessel_id, e.kind
LIMIT :count
