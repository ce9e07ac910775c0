-- Where an MMSI was
-- The points of the vessels that had this MMSI, oldest first: until its next point a vessel goes on at the speed and
-- course of the last one, within store.history_error_m. Two vessels at one time: two senders.
-- parameter: mmsi = required, nine digits
-- parameter: minutes = 60.0, how far back
WITH latest AS (
    SELECT max(time_s) AS time_s FROM cycle WHERE run_id = :run
)
SELECT c.time_s, h.vessel_id, h.latitude_deg, h.longitude_deg, h.sog_kn, h.cog_deg, h.major_m, h.mmsi, h.flags
FROM latest l
    CROSS JOIN cycle c
    CROSS JOIN history h
WHERE c.run_id = :run AND c.time_s >= l.time_s - :minutes * 60.0
    AND h.run_id = :run AND h.cycle = c.number AND h.mmsi = :mmsi AND NOT h.closing
ORDER BY c.time_s, h.vessel_id
