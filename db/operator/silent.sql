-- Vessels of which nothing was heard for a while
-- Vessels still in the picture, predicted from an old report, longest silence first. A vessel with AIS is silent after some of
-- the intervals that its class, status and speed ask for, or that it keeps. In the past these are 180 s at rest, else 10 s, and
-- a vessel that was heard again within a minute is not found.
-- parameter: seconds = 15.0, silent for at least this long
-- parameter: intervals = 2.0, and for so many of its AIS intervals
WITH latest AS (
    SELECT max(time_s) AS time_s FROM cycle WHERE run_id = :run
), expected AS (
    SELECT vessel_id, CASE
        WHEN interval_s IS NOT NULL THEN interval_s
        WHEN mmsi IS NULL THEN 0.0
        WHEN nav_status IN (1, 5, 6) OR sog_kn < 1.0 THEN 180.0
        ELSE 10.0 END AS interval_s
    FROM vessel
    WHERE run_id = :run
)
SELECT v.vessel_id, l.time_s - v.updated_s AS age_s, e.interval_s, v.latitude_deg, v.longitude_deg, v.sog_kn, v.cog_deg, v.mmsi,
    s.name, v.sources, v.flags, v.updated_s
FROM vessel v
    CROSS JOIN latest l
    JOIN expected e ON e.vessel_id = v.vessel_id
    LEFT JOIN vessel_static s ON s.run_id = v.run_id AND s.mmsi = v.mmsi
WHERE v.run_id = :run AND l.time_s - v.updated_s >= :seconds AND l.time_s - v.updated_s >= :intervals * e.interval_s
ORDER BY age_s DESC, v.vessel_id
