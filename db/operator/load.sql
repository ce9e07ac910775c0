-- Where the time of a cycle goes
-- Milliseconds of each stage, mean and longest over the newest cycles, its share of the sum of all stages, and rows a cycle.
-- parameter: cycles = 40, how many of the newest cycles
WITH latest AS (
    SELECT max(number) AS number FROM cycle WHERE run_id = :run
), recent AS (
    SELECT t.stage, t.number, t.seconds, t.rows
    FROM stage_timing t CROSS JOIN latest l
    WHERE t.run_id = :run AND t.cycle > l.number - :cycles
), total AS (
    SELECT sum(seconds) AS seconds FROM recent
)
SELECT r.stage, count(*) AS cycles, avg(r.seconds) * 1000.0 AS mean_ms, max(r.seconds) * 1000.0 AS longest_ms,
    CASE WHEN max(t.seconds) > 0.0 THEN sum(r.seconds) / max(t.seconds) ELSE 0.0 END AS share,
    CAST(avg(r.rows) AS DOUBLE PRECISION) AS rows_a_cycle
FROM recent r
    CROSS JOIN total t
GROUP BY r.stage
ORDER BY max(r.number), r.stage
