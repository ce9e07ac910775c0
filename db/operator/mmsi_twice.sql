-- One MMSI heard from two places
-- Vessels whose MMSI is on the air from elsewhere too: a copied or wrongly set identity. By MMSI.
SELECT v.vessel_id, v.latitude_deg, v.longitude_deg, v.sog_kn, v.cog_deg, v.mmsi, s.name, v.sources, v.flags, v.since_s,
    v.updated_s
FROM vessel v
    LEFT JOIN vessel_static s ON s.run_id = v.run_id AND s.mmsi = v.mmsi
WHERE v.run_id = :run AND (v.flags & 8) <> 0
ORDER BY v.mmsi, v.vessel_id
