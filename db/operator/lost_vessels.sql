-- Vessels that left the picture lately
-- Latest first, with where and how each was last: in the newest cycle of its stay of which the history is kept.
-- parameter: minutes = 10.0, how far back
-- parameter: count = 100, how many at most
WITH latest AS (
    SELECT max(time_s) AS time_s FROM cycle WHERE run_id = :run
), ended AS (
    SELECT p.run_id, p.vessel_id, p.from_cycle, p.to_cycle, p.since_s, c.time_s AS last_s
    FROM presence p
        JOIN cycle c ON c.run_id = p.run_id AND c.number = p.to_cycle
        CROSS JOIN latest l
    WHERE p.run_id = :run AND p.to_cycle IS NOT NULL AND c.time_s >= l.time_s - :minutes * 60.0
        AND NOT EXISTS (
            SELECT 1 FROM presence q
            WHERE q.run_id = p.run_id AND q.vessel_id = p.vessel_id AND q.from_cycle > p.from_cycle
        )
), kept AS (
    SELECT e.vessel_id, e.last_s, e.since_s, e.run_id, (
        SELECT max(c.number) FROM cycle c
        WHERE c.run_id = e.run_id AND c.number BETWEEN e.from_cycle AND e.to_cycle AND c.history_from IS NOT NULL
    ) AS cycle
    FROM ended e
)
SELECT k.vessel_id, k.last_s, h.latitude_deg, h.longitude_deg, h.sog_kn, h.cog_deg, h.mmsi, s.name, h.flags, k.since_s
FROM kept k
    LEFT JOIN history h ON h.run_id = k.run_id AND h.cycle = k.cycle AND h.vessel_id = k.vessel_id
    LEFT JOIN vessel_static s ON s.run_id = h.run_id AND s.mmsi = h.mmsi
ORDER BY k.last_s DESC, k.vessel_id
LIMIT :count
