-- Vessels whose AIS position and radar position have come apart
-- Vessels that AIS and radar once agreed on and no longer do. By vessel.
SELECT v.vessel_id, v.latitude_deg, v.longitude_deg, v.sog_kn, v.cog_deg, v.mmsi, s.name, v.sources, v.flags, v.since_s,
    v.updated_s
FROM vessel v
    LEFT JOIN vessel_static s ON s.run_id = v.run_id AND s.mmsi = v.mmsi
WHERE v.run_id = :run AND (v.flags & 4) <> 0
ORDER BY v.vessel_id
