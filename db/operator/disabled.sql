-- Vessels not under command or aground
-- By their own navigational status, latest report first.
SELECT v.vessel_id,
    v.latitude_deg, v.longitude_deg, v.sog_kn, v.cog_deg, v.mmsi, s.name, v.nav_status, v.sources, v.flags,
    v.since_s, v.updated_s
FROM vessel v
    LEFT JOIN vessel_static s ON s.run_id = v.run_id AND s.mmsi = v.mmsi
WHERE v.run_id = :run AND (v.flags & 3072) <> 0
ORDER BY v.updated_s DESC, v.vessel_id
