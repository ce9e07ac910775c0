-- The fastest vessels
-- Fastest first.
-- parameter: count = 10, how many
SELECT v.vessel_id, v.latitude_deg, v.longitude_deg, v.sog_kn, v.cog_deg, v.mmsi, s.name, v.sources, v.flags, v.updated_s
FROM vessel v
    LEFT JOIN vessel_static s ON s.run_id = v.run_id AND s.mmsi = v.mmsi
WHERE v.run_id = :run AND v.sog_kn IS NOT NULL
ORDER BY v.sog_kn DESC, v.vessel_id
LIMIT :count
