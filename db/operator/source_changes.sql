-- Tracks that joined or left a vessel lately
-- Latest first: a hand-over between radars, AIS switched off or on, a track that went to another vessel. One row a change; what
-- came with a new vessel or went with a lost one is not among them.
-- parameter: minutes = 10.0, how far back
-- parameter: count = 100, how many at most
WITH latest AS (
    SELECT max(time_s) AS time_s, max(number) AS number FROM cycle WHERE run_id = :run
), change AS (
    SELECT m.run_id, m.vessel_id, m.source, m.track_id, m.from_cycle AS number, 'joined' AS what
    FROM member_history m WHERE m.run_id = :run
    UNION ALL
    SELECT m.run_id, m.vessel_id, m.source, m.track_id, m.to_cycle + 1, 'left'
    FROM member_history m WHERE m.run_id = :run AND m.to_cycle IS NOT NULL
)
SELECT c.time_s, x.vessel_id, x.what, o.name AS source, o.kind, x.track_id, v.mmsi, v.latitude_deg, v.longitude_deg, v.flags
FROM change x
    JOIN cycle c ON c.run_id = x.run_id AND c.number = x.number
    JOIN source o ON o.run_id = x.run_id AND o.number = x.source
    LEFT JOIN vessel v ON v.run_id = x.run_id AND v.vessel_id = x.vessel_id
    CROSS JOIN latest l
WHERE c.time_s > l.time_s - :minutes * 60.0
    AND EXISTS (
        SELECT 1 FROM presence p
        WHERE p.run_id = x.run_id AND p.vessel_id = x.vessel_id AND p.from_cycle < x.number
            AND (p.to_cycle IS NULL OR p.to_cycle >= x.number)
    )
ORDER BY c.time_s DESC, x.vessel_id, x.what, o.number, x.track_id
LIMIT :count
