-- Where an MMSI was
-- Every kept position of the vessels that had this MMSI, oldest first. Two vessels at one time: two senders.
-- parameter: mmsi = required, nine digits
-- parameter: minutes = 60.0, how far back
WITH latest AS (
    SELECT max(time_s) AS time_s FROM cycle WHERE run_id = :run
)
SELECT c.time_s, h.vessel_id, h.latitude_deg, h.longitude_deg, h.sog_kn, h.cog_deg, h.major_m, h.mmsi, h.flags
FROM cycle c
    CROSS JOIN latest l
    JOIN history h ON h.run_id = c.run_id AND h.cycle = c.number
WHERE c.run_id = :run AND c.time_s >= l.time_s - :minutes * 60.0 AND h.mmsi = :mmsi
ORDER BY c.time_s, h.vessel_id
