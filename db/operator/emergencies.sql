-- Distress devices: AIS-SART, man overboard, emergency beacon
-- Newest first, with the kind and whether the device says that it is active. A device under test says "undefined".
SELECT v.vessel_id,
    CASE
        WHEN (v.flags & 256) <> 0 THEN 'man overboard'
        WHEN (v.flags & 512) <> 0 THEN 'epirb'
        ELSE 'ais-sart'
    END AS kind,
    CASE v.nav_status WHEN 14 THEN 'active' WHEN 15 THEN 'test or not stated' ELSE 'not stated' END AS says,
    v.latitude_deg, v.longitude_deg, v.sog_kn, v.cog_deg, v.mmsi, s.name, v.nav_status, v.sources, v.flags,
    v.since_s, v.updated_s
FROM vessel v
    LEFT JOIN vessel_static s ON s.run_id = v.run_id AND s.mmsi = v.mmsi
WHERE v.run_id = :run AND (v.flags & 896) <> 0
ORDER BY v.since_s DESC, v.vessel_id
