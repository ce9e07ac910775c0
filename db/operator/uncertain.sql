-- The vessels of whose place we are least sure
-- Largest 1-sigma ellipse first, with the age of the newest report.
-- parameter: count = 10, how many
WITH latest AS (
    SELECT max(time_s) AS time_s FROM cycle WHERE run_id = :run
)
SELECT v.vessel_id, v.major_m, v.minor_m, v.orientation_deg, l.time_s - v.updated_s AS age_s, v.latitude_deg, v.longitude_deg,
    v.sog_kn, v.mmsi, v.sources, v.flags
FROM vessel v
    CROSS JOIN latest l
WHERE v.run_id = :run AND v.major_m IS NOT NULL
ORDER BY v.major_m DESC, v.vessel_id
LIMIT :count
