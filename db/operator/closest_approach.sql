-- Vessels that are going to pass close to each other
-- Pairs that on their present course and speed come close soon, the soonest first: distance now, and distance and time of the
-- closest approach. Only pairs that are within the search radius now are looked at.
-- parameter: within_m = 300.0, metres at the closest approach
-- parameter: minutes = 12.0, the closest approach is within this time
-- parameter: search_nm = 3.0, nautical miles between the two now
-- parameter: count = 50, how many at most
WITH size AS (
    SELECT CAST(CASE WHEN wide.columns > 3.0 THEN wide.columns ELSE 3.0 END AS INTEGER) AS columns,
        :search_nm / 60.0 AS height_deg
    FROM (
        SELECT floor(360.0 * 60.0 * cos(radians(coalesce(max(abs(latitude_deg)), 0.0))) / :search_nm) AS columns
        FROM vessel WHERE run_id = :run
    ) wide
), moving AS (
    SELECT v.vessel_id, v.latitude_deg, v.longitude_deg, v.mmsi, v.sog_kn, z.columns,
        v.sog_kn * 0.5144444 * cos(radians(90.0 - coalesce(v.cog_deg, 0.0))) AS east_m_s,
        v.sog_kn * 0.5144444 * cos(radians(coalesce(v.cog_deg, 0.0))) AS north_m_s,
        CAST(floor((v.latitude_deg + 90.0) / z.height_deg) AS INTEGER) AS cell_row,
        CAST(floor((v.longitude_deg + 180.0) / 360.0 * z.columns) AS INTEGER) % z.columns AS cell_column
    FROM vessel v CROSS JOIN size z
    WHERE v.run_id = :run AND v.sog_kn IS NOT NULL
), step AS (
    SELECT -1 AS d UNION ALL SELECT 0 UNION ALL SELECT 1
), looked_at AS (
    SELECT m.*, m.cell_row + y.d AS other_row, (m.cell_column + x.d + m.columns) % m.columns AS other_column
    FROM moving m CROSS JOIN step y CROSS JOIN step x
), pair AS (
    SELECT a.vessel_id AS first_id, b.vessel_id AS second_id, a.mmsi AS first_mmsi, b.mmsi AS second_mmsi, a.latitude_deg,
        a.longitude_deg, b.east_m_s - a.east_m_s AS u, b.north_m_s - a.north_m_s AS v,
        (b.latitude_deg - a.latitude_deg) * 111120.0 AS y,
        CASE
            WHEN b.longitude_deg - a.longitude_deg > 180.0 THEN b.longitude_deg - a.longitude_deg - 360.0
            WHEN b.longitude_deg - a.longitude_deg < -180.0 THEN b.longitude_deg - a.longitude_deg + 360.0
            ELSE b.longitude_deg - a.longitude_deg
        END * 111120.0 * cos(radians((a.latitude_deg + b.latitude_deg) / 2.0)) AS x
    FROM looked_at a
        JOIN moving b ON b.cell_row = a.other_row AND b.cell_column = a.other_column
            AND b.vessel_id > a.vessel_id
), passing AS (
    SELECT p.*, -(p.x * p.u + p.y * p.v) / (p.u * p.u + p.v * p.v) AS passing_in_s
    FROM pair p
    WHERE p.x * p.x + p.y * p.y <= :search_nm * 1852.0 * :search_nm * 1852.0 AND p.u * p.u + p.v * p.v > 0.01
), passed AS (
    SELECT q.*, (q.x + q.u * q.passing_in_s) * (q.x + q.u * q.passing_in_s)
        + (q.y + q.v * q.passing_in_s) * (q.y + q.v * q.passing_in_s) AS squared_m2
    FROM passing q
    WHERE q.passing_in_s BETWEEN 0.0 AND :minutes * 60.0
)
SELECT first_id, second_id, passing_in_s, sqrt(squared_m2) AS passing_m, sqrt(x * x + y * y) AS distance_m, first_mmsi,
    second_mmsi, latitude_deg, longitude_deg
FROM passed
WHERE squared_m2 <= :within_m * :within_m
ORDER BY passing_in_s, first_id, second_id
LIMIT :count
