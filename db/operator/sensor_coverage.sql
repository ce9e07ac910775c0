-- What each source contributes to the picture
-- For each source: its tracks in the picture, the vessels they are of, and the vessels that no other source has.
WITH held AS (
    SELECT vessel_id, source, count(*) AS tracks FROM member WHERE run_id = :run GROUP BY vessel_id, source
), beside AS (
    SELECT source, tracks, CASE WHEN count(*) OVER (PARTITION BY vessel_id) = 1 THEN 1 ELSE 0 END AS alone FROM held
), summed AS (
    SELECT source, sum(tracks) AS tracks, count(*) AS vessels, sum(alone) AS vessels_of_it_alone FROM beside GROUP BY source
)
SELECT o.number, o.name, o.kind, CAST(coalesce(s.tracks, 0) AS INTEGER) AS tracks, coalesce(s.vessels, 0) AS vessels,
    coalesce(s.vessels_of_it_alone, 0) AS vessels_of_it_alone
FROM source o
    LEFT JOIN summed s ON s.source = o.number
WHERE o.run_id = :run
ORDER BY o.number
