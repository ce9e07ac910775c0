-- Bearing tracks and the vessels they were given to
-- One row a bearing track. No vessel: something is heard that nothing else sees. At an instant of the past only the tracks that
-- were given to a vessel are known, without rates; latitude and longitude are those of the sonar in the scenario.
SELECT b.track_id, o.name AS source, b.bearing_deg, b.rate_deg_s, b.vessel_id, v.mmsi, v.flags, b.latitude_deg, b.longitude_deg,
    b.updated_s
FROM bearing_track b
    JOIN source o ON o.run_id = b.run_id AND o.number = b.source
    LEFT JOIN vessel v ON v.run_id = b.run_id AND v.vessel_id = b.vessel_id
WHERE b.run_id = :run
ORDER BY b.source, b.track_id
