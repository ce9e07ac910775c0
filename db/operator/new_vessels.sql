-- Vessels that came into the picture lately
-- Newest first, with the time at which each came. One that was lost and has returned is among them, with its old number.
-- parameter: minutes = 10.0, how far back
-- parameter: count = 100, how many at most
WITH latest AS (
    SELECT max(time_s) AS time_s FROM cycle WHERE run_id = :run
)
SELECT v.vessel_id, c.time_s AS from_s, v.latitude_deg, v.longitude_deg, v.sog_kn, v.cog_deg, v.mmsi, s.name, v.sources,
    v.flags, v.since_s
FROM latest l
    CROSS JOIN cycle c
    CROSS JOIN presence came
    CROSS JOIN presence p
    JOIN vessel v ON v.run_id = p.run_id AND v.vessel_id = p.vessel_id
    LEFT JOIN vessel_static s ON s.run_id = v.run_id AND s.mmsi = v.mmsi
WHERE c.run_id = :run AND c.time_s > l.time_s - :minutes * 60.0
    AND came.run_id = :run AND came.from_cycle = c.number
    AND p.run_id = :run AND p.vessel_id = came.vessel_id AND p.from_cycle = c.number AND p.to_cycle IS NULL
ORDER BY c.time_s DESC, v.vessel_id
LIMIT :count
