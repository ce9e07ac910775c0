-- Stationary objects: quays, buoys, moored and anchored vessels
-- What has stayed in one place, longest first. Without AIS it is not dark: it is as likely a quay as a vessel.
-- parameter: seconds = 0.0, stationary for at least this long
WITH latest AS (
    SELECT max(time_s) AS time_s FROM cycle WHERE run_id = :run
)
SELECT v.vessel_id, v.latitude_deg, v.longitude_deg, v.mmsi, s.name, v.sources, v.flags, e.start_s,
    l.time_s - e.start_s AS stationary_for_s, v.updated_s
FROM vessel v
    CROSS JOIN latest l
    LEFT JOIN vessel_static s ON s.run_id = v.run_id AND s.mmsi = v.mmsi
    LEFT JOIN event e ON e.run_id = v.run_id AND e.vessel_id = v.vessel_id AND e.kind = 'stationary' AND e.end_s IS NULL
WHERE v.run_id = :run AND (v.flags & 4096) <> 0 AND coalesce(l.time_s - e.start_s, 0.0) >= :seconds
ORDER BY e.start_s IS NULL, e.start_s, v.vessel_id
