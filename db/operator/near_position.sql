-- Vessels near a position
-- Nearest first, with the distance. The distance is of a sphere, good to 0.5 % within 100 NM.
-- parameter: latitude_deg = required, degrees north
-- parameter: longitude_deg = required, degrees east
-- parameter: radius_nm = 2.0, nautical miles around the position
WITH apart AS (
    SELECT v.*, (v.latitude_deg - :latitude_deg) * 60.0 AS north_nm,
        CASE
            WHEN v.longitude_deg - :longitude_deg > 180.0 THEN v.longitude_deg - :longitude_deg - 360.0
            WHEN v.longitude_deg - :longitude_deg < -180.0 THEN v.longitude_deg - :longitude_deg + 360.0
            ELSE v.longitude_deg - :longitude_deg
        END * 60.0 * cos(radians((v.latitude_deg + :latitude_deg) / 2.0)) AS east_nm
    FROM vessel v
    WHERE v.run_id = :run AND abs(v.latitude_deg - :latitude_deg) * 60.0 <= :radius_nm
)
SELECT a.vessel_id, sqrt(a.north_nm * a.north_nm + a.east_nm * a.east_nm) AS distance_nm, a.latitude_deg, a.longitude_deg,
    a.sog_kn, a.cog_deg, a.mmsi, s.name, a.sources, a.flags, a.updated_s
FROM apart a
    LEFT JOIN vessel_static s ON s.run_id = a.run_id AND s.mmsi = a.mmsi
WHERE a.north_nm * a.north_nm + a.east_nm * a.east_nm <= :radius_nm * :radius_nm
ORDER BY distance_nm, a.vessel_id
