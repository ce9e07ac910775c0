-- Vessels that left the picture lately
-- Latest first, with where and how each was last, within store.history_error_m of the picture.
-- parameter: minutes = 10.0, how far back
-- parameter: count = 100, how many at most
WITH latest AS (
    SELECT max(time_s) AS time_s FROM cycle WHERE run_id = :run
), ended AS (
    SELECT p.run_id, p.vessel_id, p.from_cycle, p.to_cycle, p.since_s, c.time_s AS last_s
    FROM latest l
        CROSS JOIN cycle c
        CROSS JOIN presence gone
        CROSS JOIN presence p
    WHERE c.run_id = :run AND c.time_s >= l.time_s - :minutes * 60.0
        AND gone.run_id = :run AND gone.to_cycle = c.number AND gone.to_cycle IS NOT NULL
        AND p.run_id = :run AND p.vessel_id = gone.vessel_id AND p.from_cycle = gone.from_cycle
        AND NOT EXISTS (
            SELECT 1 FROM presence q
            WHERE q.run_id = p.run_id AND q.vessel_id = p.vessel_id AND q.from_cycle > p.from_cycle
        )
)
SELECT e.vessel_id, e.last_s, h.latitude_deg, h.longitude_deg, h.sog_kn, h.cog_deg, h.mmsi, s.name, h.flags, e.since_s
FROM ended e
    LEFT JOIN history h ON h.run_id = e.run_id AND h.cycle = e.to_cycle + 1 AND h.vessel_id = e.vessel_id AND h.closing
    LEFT JOIN vessel_static s ON s.run_id = h.run_id AND s.mmsi = h.mmsi
ORDER BY e.last_s DESC, e.vessel_id
LIMIT :count
