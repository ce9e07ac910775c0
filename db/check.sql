-- What holds of a database that has whole cycles only; each query gives the runs of which it does not. `coastwatch db check` asks all.

-- cycles are numbered without a gap, from 0 where none is deleted
SELECT run_id FROM cycle GROUP BY run_id HAVING count(*) <> max(number) - min(number) + 1;

-- a cycle has as many rows of history as it says
SELECT c.run_id FROM cycle c LEFT JOIN (SELECT run_id, cycle, count(*) AS n FROM history GROUP BY run_id, cycle) h
    ON h.run_id = c.run_id AND h.cycle = c.number
WHERE c.history_from IS NOT NULL AND coalesce(h.n, 0) <> c.history_points;

-- a kept cycle has as many associations as pairs
SELECT c.run_id FROM cycle c LEFT JOIN (SELECT run_id, cycle, count(*) AS n FROM association GROUP BY run_id, cycle) a
    ON a.run_id = c.run_id AND a.cycle = c.number
WHERE c.associations_kept AND coalesce(a.n, 0) <> c.pairs;

-- a kept cycle has as many bearing associations as bearing pairs
SELECT c.run_id FROM cycle c
    LEFT JOIN (SELECT run_id, cycle, count(*) AS n FROM bearing_association GROUP BY run_id, cycle) a
    ON a.run_id = c.run_id AND a.cycle = c.number
WHERE c.associations_kept AND coalesce(a.n, 0) <> c.bearing_pairs;

-- rows of history belong to a cycle
SELECT h.run_id FROM (SELECT DISTINCT run_id, cycle FROM history) h
    LEFT JOIN cycle c ON c.run_id = h.run_id AND c.number = h.cycle WHERE c.number IS NULL;

-- timings belong to a cycle
SELECT t.run_id FROM (SELECT DISTINCT run_id, cycle FROM stage_timing) t
    LEFT JOIN cycle c ON c.run_id = t.run_id AND c.number = t.cycle WHERE c.number IS NULL;

-- the picture has the vessels of the cycle in which it was written
SELECT c.run_id FROM cycle c JOIN (SELECT run_id, max(number) AS n FROM cycle WHERE picture_kept GROUP BY run_id) l
    ON l.run_id = c.run_id AND l.n = c.number
WHERE c.vessels <> (SELECT count(*) FROM vessel v WHERE v.run_id = c.run_id);

-- the vessels of the picture are those that were present
SELECT v.run_id FROM vessel v JOIN (SELECT run_id, max(number) AS n FROM cycle WHERE picture_kept GROUP BY run_id) l
    ON l.run_id = v.run_id
WHERE NOT EXISTS (SELECT 1 FROM presence p WHERE p.run_id = v.run_id AND p.vessel_id = v.vessel_id
    AND p.from_cycle <= l.n AND (p.to_cycle IS NULL OR p.to_cycle >= l.n));

-- as many vessels are present as the newest cycle says
SELECT c.run_id FROM cycle c JOIN (SELECT run_id, max(number) AS n FROM cycle GROUP BY run_id) l
    ON l.run_id = c.run_id AND l.n = c.number
WHERE c.vessels <> (SELECT count(*) FROM presence p WHERE p.run_id = c.run_id AND p.to_cycle IS NULL);

-- a vessel that has left has a closing point
SELECT p.run_id FROM presence p
    JOIN cycle c ON c.run_id = p.run_id AND c.number = p.to_cycle + 1 AND c.history_from IS NOT NULL
    JOIN history f ON f.run_id = p.run_id AND f.cycle = p.from_cycle AND f.vessel_id = p.vessel_id
WHERE NOT EXISTS (SELECT 1 FROM history h
    WHERE h.run_id = p.run_id AND h.cycle = p.to_cycle + 1 AND h.vessel_id = p.vessel_id AND h.closing);

-- every vessel of the newest cycle has a point since the cycle that it names
SELECT c.run_id FROM cycle c JOIN (SELECT run_id, max(number) AS n FROM cycle GROUP BY run_id) l
    ON l.run_id = c.run_id AND l.n = c.number
WHERE c.history_from IS NOT NULL AND c.vessels > (SELECT count(DISTINCT h.vessel_id) FROM history h
    WHERE h.run_id = c.run_id AND h.cycle BETWEEN c.history_from AND c.number AND NOT h.closing);

-- the members are those whose stay has not ended
SELECT m.run_id FROM member m GROUP BY m.run_id
HAVING count(*) <> (SELECT count(*) FROM member_history h WHERE h.run_id = m.run_id AND h.to_cycle IS NULL);

-- a recorded cycle has all of its vessels
SELECT c.run_id FROM cycle c
    LEFT JOIN recording r ON r.run_id = c.run_id AND r.cycle = c.number
WHERE c.recorded AND coalesce(r.vessels, -1) <> c.vessels;

-- a flag that lasts is of a vessel that is in the picture
SELECT e.run_id FROM event e
WHERE e.to_cycle IS NULL AND e.kind IN ('dark', 'ais_without_radar', 'ais_contradicted', 'mmsi_twice', 'impossible_speed', 'coasting',
    'odd_mmsi', 'ais_sart', 'man_overboard', 'epirb', 'not_under_command', 'aground', 'stationary') AND NOT EXISTS (SELECT 1 FROM presence p
    WHERE p.run_id = e.run_id AND p.vessel_id = e.vessel_id AND p.to_cycle IS NULL);

-- a gap of an event is between cycles of the event
SELECT g.run_id FROM event_gap g
    LEFT JOIN event e ON e.run_id = g.run_id AND e.vessel_id = g.vessel_id AND e.kind = g.kind
        AND e.subject = g.subject AND e.from_cycle = g.from_cycle
WHERE e.run_id IS NULL OR g.last_cycle < e.from_cycle OR g.cycle > coalesce(e.to_cycle, g.cycle);

-- no checkpoint is newer than the newest cycle
SELECT k.run_id FROM checkpoint k WHERE k.cycle > (SELECT max(number) FROM cycle c WHERE c.run_id = k.run_id);
