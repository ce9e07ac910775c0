-- Vessels of which nothing was heard for a while
-- Vessels still in the picture, predicted from an old report, longest silence first.
-- parameter: seconds = 15.0, silent for at least this long
WITH latest AS (
    SELECT max(time_s) AS time_s FROM cycle WHERE run_id = :run
)
SELECT v.vessel_id, l.time_s - v.updated_s AS age_s, v.latitude_deg, v.longitude_deg, v.sog_kn, v.cog_deg, v.mmsi, s.name,
    v.sources, v.flags, v.updated_s
FROM vessel v
    CROSS JOIN latest l
    LEFT JOIN vessel_static s ON s.run_id = v.run_id AND s.mmsi = v.mmsi
WHERE v.run_id = :run AND l.time_s - v.updated_s >= :seconds
ORDER BY age_s DESC, v.vessel_id
