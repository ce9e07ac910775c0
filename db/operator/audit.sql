-- Audit: who changed what through the API of a server
-- Latest first, of all runs. `who` is the name of the token, or of the user of a trusted proxy; loopback: this machine, without
-- a token. `body` is the beginning of what was sent.
-- parameter: from_s = 0.0, changes at this instant or later, seconds since 1970 UTC (option --from takes UTC)
-- parameter: to_s = 253402300800.0, changes at this instant or earlier (option --to takes UTC)
-- parameter: count = 1000, how many at most
SELECT a.id AS change_id, a.time_s, a.who, a.role, a.client, a.method, a.path, a.http_status, a.body
FROM audit a
WHERE a.time_s >= :from_s AND a.time_s <= :to_s
ORDER BY a.id DESC
LIMIT :count
