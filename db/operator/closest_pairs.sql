-- Vessels that are close to each other now
-- Each pair once, closest first, with the distance. Found by cells of the size of the distance, not by comparing all pairs.
-- parameter: within_m = 500.0, metres
-- parameter: min_sog_kn = 1.0, at least one of the two is as fast
-- parameter: count = 50, how many at most
WITH size AS (
    SELECT CAST(CASE WHEN wide.columns > 3.0 THEN wide.columns ELSE 3.0 END AS INTEGER) AS columns,
        :within_m / 111120.0 AS height_deg
    FROM (
        SELECT floor(360.0 * 111120.0 * cos(radians(coalesce(max(abs(latitude_deg)), 0.0))) / :within_m) AS columns
        FROM vessel WHERE run_id = :run
    ) wide
), placed AS (
    SELECT v.vessel_id, v.latitude_deg, v.longitude_deg, coalesce(v.sog_kn, 0.0) AS sog_kn, v.mmsi, v.flags, z.columns,
        CAST(floor((v.latitude_deg + 90.0) / z.height_deg) AS INTEGER) AS cell_row,
        CAST(floor((v.longitude_deg + 180.0) / 360.0 * z.columns) AS INTEGER) % z.columns AS cell_column
    FROM vessel v CROSS JOIN size z
    WHERE v.run_id = :run
), step AS (
    SELECT -1 AS d UNION ALL SELECT 0 UNION ALL SELECT 1
), looked_at AS (
    SELECT p.*, p.cell_row + y.d AS other_row, (p.cell_column + x.d + p.columns) % p.columns AS other_column
    FROM placed p CROSS JOIN step y CROSS JOIN step x
), apart AS (
    SELECT a.vessel_id AS first_id, b.vessel_id AS second_id, a.latitude_deg, a.longitude_deg, a.sog_kn AS first_sog_kn,
        b.sog_kn AS second_sog_kn, a.mmsi AS first_mmsi, b.mmsi AS second_mmsi,
        (b.latitude_deg - a.latitude_deg) * 111120.0 AS north_m,
        CASE
            WHEN b.longitude_deg - a.longitude_deg > 180.0 THEN b.longitude_deg - a.longitude_deg - 360.0
            WHEN b.longitude_deg - a.longitude_deg < -180.0 THEN b.longitude_deg - a.longitude_deg + 360.0
            ELSE b.longitude_deg - a.longitude_deg
        END * 111120.0 * cos(radians((a.latitude_deg + b.latitude_deg) / 2.0)) AS east_m
    FROM looked_at a
        JOIN placed b ON b.cell_row = a.other_row AND b.cell_column = a.other_column
            AND b.vessel_id > a.vessel_id
)
SELECT first_id, second_id, sqrt(north_m * north_m + east_m * east_m) AS distance_m, first_sog_kn, second_sog_kn, first_mmsi,
    second_mmsi, latitude_deg, longitude_deg
FROM apart
WHERE north_m * north_m + east_m * east_m <= :within_m * :within_m
    AND (first_sog_kn >= :min_sog_kn OR second_sog_kn >= :min_sog_kn)
ORDER BY distance_m, first_id, second_id
LIMIT :count
