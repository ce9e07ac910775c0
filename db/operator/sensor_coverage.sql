-- What each source contributes to the picture
-- For each source: its tracks in the picture, the vessels they are of, and the vessels that no other source has.
WITH held AS (
    SELECT vessel_id, source, count(*) AS tracks FROM member WHERE run_id = :run GROUP BY vessel_id, source
), alone AS (
    SELECT vessel_id FROM held GROUP BY vessel_id HAVING count(*) = 1
)
SELECT o.number, o.name, o.kind, CAST(coalesce(sum(h.tracks), 0) AS INTEGER) AS tracks, count(h.vessel_id) AS vessels,
    count(a.vessel_id) AS vessels_of_it_alone
FROM source o
    LEFT JOIN held h ON h.source = o.number
    LEFT JOIN alone a ON a.vessel_id = h.vessel_id
WHERE o.run_id = :run
GROUP BY o.number, o.name, o.kind
ORDER BY o.number
