-- What each source contributes to the picture
-- For each source: its tracks in the picture, the vessels they are of, and the vessels that no other source has.
WITH contributes AS (
    SELECT source, vessel_id, count(*) AS tracks FROM member WHERE run_id = :run GROUP BY vessel_id, source
),
alone AS (
    SELECT min(source) AS source, vessel_id FROM contributes GROUP BY vessel_id HAVING count(*) = 1
)
SELECT s.number, s.name, s.kind, coalesce(t.tracks, 0) AS tracks, coalesce(t.vessels, 0) AS vessels,
    coalesce(a.vessels, 0) AS vessels_of_it_alone
FROM source s
    LEFT JOIN (SELECT source, CAST(sum(tracks) AS INTEGER) AS tracks, count(*) AS vessels FROM contributes GROUP BY source) t
        ON t.source = s.number
    LEFT JOIN (SELECT source, count(*) AS vessels FROM alone GROUP BY source) a ON a.source = s.number
WHERE s.run_id = :run
ORDER BY s.number
