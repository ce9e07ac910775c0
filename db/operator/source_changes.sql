-- Tracks that joined or left a vessel lately
-- Latest first: a hand-over between radars, AIS switched off or on, a track that went to another vessel. One row a change; what
-- came with a new vessel or went with a lost one is not among them.
-- parameter: minutes = 10.0, how far back
-- parameter: count = 100, how many at most
WITH latest AS (
    SELECT max(time_s) AS time_s FROM cycle WHERE run_id = :run
), recent AS (
    SELECT c.number, c.time_s
    FROM latest l CROSS JOIN cycle c
    WHERE c.run_id = :run AND c.time_s > l.time_s - :minutes * 60.0
), change AS (
    SELECT c.time_s, m.run_id, m.vessel_id, m.source, m.track_id, c.number, 'joined' AS what
    FROM recent c CROSS JOIN member_history m WHERE m.run_id = :run AND m.from_cycle = c.number
    UNION ALL
    SELECT c.time_s, m.run_id, m.vessel_id, m.source, m.track_id, c.number, 'left'
    FROM recent c CROSS JOIN member_history m
    WHERE m.run_id = :run AND m.to_cycle = c.number - 1 AND m.to_cycle IS NOT NULL
)
SELECT x.time_s, x.vessel_id, x.what, o.name AS source, o.kind, x.track_id, v.mmsi, v.latitude_deg, v.longitude_deg, v.flags
FROM change x
    JOIN source o ON o.run_id = x.run_id AND o.number = x.source
    LEFT JOIN vessel v ON v.run_id = x.run_id AND v.vessel_id = x.vessel_id
WHERE EXISTS (
    SELECT 1 FROM presence p
    WHERE p.run_id = x.run_id AND p.vessel_id = x.vessel_id AND p.from_cycle < x.number
        AND (p.to_cycle IS NULL OR p.to_cycle >= x.number)
)
ORDER BY x.time_s DESC, x.vessel_id, x.what, o.number, x.track_id
LIMIT :count
