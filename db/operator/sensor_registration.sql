-- Registration of radars, and bias of sonars
-- One row a sensor but AIS receivers: state, the errors that are taken out of its reports with what is not known of them, when
-- it was heard last, and by how much its azimuth bias has changed. No sigma: nothing is known yet. The candidate is the
-- bias with the most evidence, odds are those against chance.
-- parameter: minutes = 60.0, over which the change is
WITH latest AS (
    SELECT max(number) AS number, max(time_s) AS time_s FROM cycle WHERE run_id = :run
), newest AS (
    SELECT kind, number, max(cycle) AS cycle FROM sensor_registration WHERE run_id = :run GROUP BY kind, number
), former AS (
    SELECT r.kind, r.number, min(r.cycle) AS cycle
    FROM sensor_registration r
        JOIN cycle c ON c.run_id = r.run_id AND c.number = r.cycle
        CROSS JOIN latest l
    WHERE r.run_id = :run AND c.time_s >= l.time_s - 60.0 * :minutes
    GROUP BY r.kind, r.number
)
SELECT s.kind, s.name, r.state, r.azimuth_bias_deg, r.azimuth_sigma_deg, r.range_bias_m, r.range_sigma_m,
    r.range_scale, r.range_scale_sigma, r.time_lag_s, r.estimated_lag_s, r.lag_sigma_s,
    r.site_east_m, r.site_north_m, r.site_sigma_m, r.vessels,
    r.candidate_azimuth_deg, r.candidate_range_m, r.odds, r.found_odds, r.voices, r.rival_share, r.compared,
    r.azimuth_bias_deg - o.azimuth_bias_deg AS azimuth_change_deg, r.heard_s
FROM newest n
    JOIN sensor s ON s.run_id = :run AND s.kind = n.kind AND s.number = n.number
    JOIN sensor_registration r
        ON r.run_id = :run AND r.cycle = n.cycle AND r.kind = n.kind AND r.number = n.number
    LEFT JOIN former f ON f.kind = n.kind AND f.number = n.number
    LEFT JOIN sensor_registration o
        ON o.run_id = :run AND o.cycle = f.cycle AND o.kind = f.kind AND o.number = f.number
WHERE s.kind <> 'ais'
ORDER BY s.kind DESC, s.number
