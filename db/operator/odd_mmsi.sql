-- Vessels whose MMSI is not one that a vessel has
-- By MMSI, as it was sent: an unset or wrongly typed number, or one that hides who is there.
SELECT v.vessel_id,
    v.latitude_deg, v.longitude_deg, v.sog_kn, v.cog_deg, v.mmsi, s.name, v.nav_status, v.sources, v.flags,
    v.since_s, v.updated_s
FROM vessel v
    LEFT JOIN vessel_static s ON s.run_id = v.run_id AND s.mmsi = v.mmsi
WHERE v.run_id = :run AND (v.flags & 64) <> 0
ORDER BY v.mmsi, v.vessel_id
