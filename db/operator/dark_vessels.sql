-- Vessels under way without AIS where AIS is heard
-- Vessels that radar sees inside AIS coverage and that send no AIS, fastest first, and for how long they
-- have been watched.
-- parameter: min_sog_kn = 1.0, slower vessels are left out: what lies still often has AIS off
WITH latest AS (
    SELECT max(time_s) AS time_s FROM cycle WHERE run_id = :run
)
SELECT v.vessel_id, v.latitude_deg, v.longitude_deg, v.sog_kn, v.cog_deg, v.sources, v.major_m, v.since_s, v.updated_s,
    l.time_s - v.since_s AS watched_for_s
FROM vessel v
    CROSS JOIN latest l
WHERE v.run_id = :run AND (v.flags & 1) <> 0 AND coalesce(v.sog_kn, 0.0) >= :min_sog_kn
ORDER BY v.sog_kn IS NULL, v.sog_kn DESC, v.vessel_id
