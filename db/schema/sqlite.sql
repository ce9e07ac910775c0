-- Generated from coastwatch/store/schema/tables.py, schema 0028, by `make docs`.

CREATE TABLE audit (
	id INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
	time_s FLOAT NOT NULL,
	who TEXT NOT NULL,
	role VARCHAR(16) NOT NULL,
	client TEXT NOT NULL,
	method VARCHAR(16) NOT NULL,
	path TEXT NOT NULL,
	http_status INTEGER NOT NULL,
	body TEXT NOT NULL
);

CREATE TABLE run (
	id INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
	scenario TEXT NOT NULL,
	title TEXT NOT NULL,
	seed INTEGER NOT NULL,
	version VARCHAR(32) NOT NULL,
	settings JSON NOT NULL,
	command TEXT NOT NULL,
	started_utc VARCHAR(32) NOT NULL,
	finished_utc VARCHAR(32),
	written_utc VARCHAR(32),
	machine TEXT,
	process INTEGER,
	status VARCHAR(16) NOT NULL,
	period_s FLOAT NOT NULL,
	cycles INTEGER NOT NULL,
	warmup_cycles INTEGER NOT NULL,
	start_s FLOAT NOT NULL,
	workers INTEGER NOT NULL,
	scores JSON,
	verdict JSON,
	faults JSON NOT NULL
);

CREATE TABLE vessel (
	run_id INTEGER NOT NULL,
	vessel_id INTEGER NOT NULL,
	time_s FLOAT NOT NULL,
	latitude_deg FLOAT NOT NULL,
	longitude_deg FLOAT NOT NULL,
	sog_kn FLOAT,
	cog_deg FLOAT,
	major_m FLOAT,
	minor_m FLOAT,
	orientation_deg FLOAT,
	since_s FLOAT NOT NULL,
	updated_s FLOAT NOT NULL,
	mmsi INTEGER,
	flags INTEGER NOT NULL,
	sources TEXT NOT NULL,
	covariance BLOB,
	nav_status INTEGER,
	interval_s FLOAT,
	existence FLOAT,
	echo_length_m FLOAT,
	echo_width_m FLOAT,
	echo_axis_deg FLOAT,
	alternative_m FLOAT,
	PRIMARY KEY (run_id, vessel_id)
)
 WITHOUT ROWID;

CREATE TABLE zone (
	number INTEGER NOT NULL,
	version INTEGER NOT NULL,
	scenario TEXT NOT NULL,
	definition JSON,
	changed_s FLOAT NOT NULL,
	changed_by TEXT NOT NULL,
	PRIMARY KEY (number, version)
)
 WITHOUT ROWID;

CREATE INDEX zone_scenario ON zone (scenario, number, version);

CREATE TABLE acknowledgement (
	run_id INTEGER NOT NULL,
	vessel_id INTEGER NOT NULL,
	kind VARCHAR(32) NOT NULL,
	subject INTEGER NOT NULL,
	from_cycle INTEGER NOT NULL,
	acknowledged_s FLOAT NOT NULL,
	acknowledged_by TEXT NOT NULL,
	note TEXT NOT NULL,
	who TEXT NOT NULL,
	PRIMARY KEY (run_id, vessel_id, kind, subject, from_cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE INDEX acknowledgement_time ON acknowledgement (run_id, acknowledged_s);

CREATE TABLE ais_feed (
	run_id INTEGER NOT NULL,
	number INTEGER NOT NULL,
	name TEXT NOT NULL,
	PRIMARY KEY (run_id, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE association (
	run_id INTEGER NOT NULL,
	cycle INTEGER NOT NULL,
	vessel_id INTEGER NOT NULL,
	first_source INTEGER NOT NULL,
	first_track INTEGER NOT NULL,
	second_source INTEGER NOT NULL,
	second_track INTEGER NOT NULL,
	statistic FLOAT,
	PRIMARY KEY (run_id, cycle, vessel_id, first_source, first_track, second_source, second_track),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE TABLE bearing_association (
	run_id INTEGER NOT NULL,
	cycle INTEGER NOT NULL,
	vessel_id INTEGER NOT NULL,
	source INTEGER NOT NULL,
	bearing_track INTEGER NOT NULL,
	statistic FLOAT,
	bearing_deg FLOAT NOT NULL,
	PRIMARY KEY (run_id, cycle, vessel_id, source, bearing_track),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE TABLE bearing_track (
	run_id INTEGER NOT NULL,
	source INTEGER NOT NULL,
	track_id INTEGER NOT NULL,
	bearing_deg FLOAT NOT NULL,
	rate_deg_s FLOAT,
	latitude_deg FLOAT NOT NULL,
	longitude_deg FLOAT NOT NULL,
	vessel_id INTEGER,
	updated_s FLOAT NOT NULL,
	PRIMARY KEY (run_id, source, track_id),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE TABLE checkpoint (
	run_id INTEGER NOT NULL,
	piece INTEGER NOT NULL,
	cycle INTEGER NOT NULL,
	memory BLOB NOT NULL,
	PRIMARY KEY (run_id, piece),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE cycle (
	run_id INTEGER NOT NULL,
	number INTEGER NOT NULL,
	time_s FLOAT NOT NULL,
	vessels INTEGER NOT NULL,
	tracks INTEGER NOT NULL,
	pairs INTEGER NOT NULL,
	bearing_pairs INTEGER NOT NULL,
	reports INTEGER NOT NULL,
	picture_kept BOOLEAN NOT NULL,
	history_from INTEGER,
	history_points INTEGER NOT NULL,
	associations_kept BOOLEAN NOT NULL,
	recorded BOOLEAN DEFAULT 0 NOT NULL,
	skipped VARCHAR(16),
	PRIMARY KEY (run_id, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE INDEX cycle_time ON cycle (run_id, time_s);

CREATE TABLE decided_path (
	run_id INTEGER NOT NULL,
	cycle INTEGER NOT NULL,
	vessel_id INTEGER NOT NULL,
	number INTEGER NOT NULL,
	time_s FLOAT NOT NULL,
	latitude_deg FLOAT NOT NULL,
	longitude_deg FLOAT NOT NULL,
	sog_kn FLOAT,
	cog_deg FLOAT,
	major_m FLOAT,
	minor_m FLOAT,
	orientation_deg FLOAT,
	track_id INTEGER NOT NULL,
	radar INTEGER,
	PRIMARY KEY (run_id, cycle, vessel_id, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE TABLE event (
	run_id INTEGER NOT NULL,
	vessel_id INTEGER NOT NULL,
	kind VARCHAR(32) NOT NULL,
	subject INTEGER NOT NULL,
	from_cycle INTEGER NOT NULL,
	to_cycle INTEGER,
	start_s FLOAT NOT NULL,
	end_s FLOAT,
	latitude_deg FLOAT NOT NULL,
	longitude_deg FLOAT NOT NULL,
	sog_kn FLOAT,
	mmsi INTEGER,
	evidence TEXT NOT NULL,
	unacknowledged BOOLEAN DEFAULT 0 NOT NULL,
	PRIMARY KEY (run_id, vessel_id, kind, subject, from_cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE INDEX event_start ON event (run_id, start_s);

CREATE INDEX event_to ON event (run_id, to_cycle);

CREATE INDEX event_unacknowledged ON event (run_id, start_s) WHERE unacknowledged;

CREATE TABLE event_gap (
	run_id INTEGER NOT NULL,
	vessel_id INTEGER NOT NULL,
	kind VARCHAR(32) NOT NULL,
	subject INTEGER NOT NULL,
	from_cycle INTEGER NOT NULL,
	cycle INTEGER NOT NULL,
	last_cycle INTEGER NOT NULL,
	last_s FLOAT NOT NULL,
	PRIMARY KEY (run_id, vessel_id, kind, subject, from_cycle, cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE INDEX event_gap_cycle ON event_gap (run_id, cycle);

CREATE TABLE history (
	run_id INTEGER NOT NULL,
	cycle INTEGER NOT NULL,
	vessel_id INTEGER NOT NULL,
	latitude_deg FLOAT NOT NULL,
	longitude_deg FLOAT NOT NULL,
	sog_kn FLOAT,
	cog_deg FLOAT,
	major_m FLOAT,
	minor_m FLOAT,
	orientation_deg FLOAT,
	updated_s FLOAT NOT NULL,
	mmsi INTEGER,
	flags INTEGER NOT NULL,
	previous_cycle INTEGER,
	closing BOOLEAN DEFAULT 0 NOT NULL,
	nav_status INTEGER,
	PRIMARY KEY (run_id, cycle, vessel_id),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE INDEX history_box ON history (run_id, cycle, latitude_deg, longitude_deg);

CREATE TABLE identity (
	run_id INTEGER NOT NULL,
	mmsi INTEGER NOT NULL,
	vessel_id INTEGER NOT NULL,
	from_cycle INTEGER NOT NULL,
	to_cycle INTEGER,
	PRIMARY KEY (run_id, mmsi, vessel_id, from_cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE INDEX identity_to ON identity (run_id, to_cycle) WHERE to_cycle IS NOT NULL;

CREATE TABLE member (
	run_id INTEGER NOT NULL,
	vessel_id INTEGER NOT NULL,
	source INTEGER NOT NULL,
	track_id INTEGER NOT NULL,
	PRIMARY KEY (run_id, vessel_id, source, track_id),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE TABLE member_history (
	run_id INTEGER NOT NULL,
	vessel_id INTEGER NOT NULL,
	source INTEGER NOT NULL,
	track_id INTEGER NOT NULL,
	from_cycle INTEGER NOT NULL,
	to_cycle INTEGER,
	PRIMARY KEY (run_id, vessel_id, source, track_id, from_cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE INDEX member_history_from ON member_history (run_id, from_cycle);

CREATE INDEX member_history_to ON member_history (run_id, to_cycle) WHERE to_cycle IS NOT NULL;

CREATE TABLE presence (
	run_id INTEGER NOT NULL,
	vessel_id INTEGER NOT NULL,
	from_cycle INTEGER NOT NULL,
	to_cycle INTEGER,
	since_s FLOAT NOT NULL,
	PRIMARY KEY (run_id, vessel_id, from_cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE INDEX presence_from ON presence (run_id, from_cycle);

CREATE INDEX presence_to ON presence (run_id, to_cycle) WHERE to_cycle IS NOT NULL;

CREATE TABLE recording (
	run_id INTEGER NOT NULL,
	cycle INTEGER NOT NULL,
	vessels INTEGER NOT NULL,
	members INTEGER NOT NULL,
	vessel_id BLOB NOT NULL,
	time_s BLOB NOT NULL,
	position_deg BLOB NOT NULL,
	velocity_m_s BLOB NOT NULL,
	covariance BLOB NOT NULL,
	since_s BLOB NOT NULL,
	updated_s BLOB NOT NULL,
	mmsi BLOB NOT NULL,
	flags BLOB NOT NULL,
	origin BLOB NOT NULL,
	member_vessel_id BLOB NOT NULL,
	member_track_id BLOB NOT NULL,
	member_source BLOB NOT NULL,
	nav_status BLOB,
	existence BLOB,
	alternative_m BLOB,
	echo_length_m BLOB,
	echo_width_m BLOB,
	echo_axis_deg BLOB,
	PRIMARY KEY (run_id, cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE region_intake (
	run_id INTEGER NOT NULL,
	cycle INTEGER NOT NULL,
	number INTEGER NOT NULL,
	region TEXT NOT NULL,
	region_run VARCHAR(64) NOT NULL,
	first_seq INTEGER NOT NULL,
	last_seq INTEGER NOT NULL,
	late INTEGER NOT NULL,
	PRIMARY KEY (run_id, cycle, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE TABLE sensor (
	run_id INTEGER NOT NULL,
	kind VARCHAR(16) NOT NULL,
	number INTEGER NOT NULL,
	name TEXT NOT NULL,
	latitude_deg FLOAT NOT NULL,
	longitude_deg FLOAT NOT NULL,
	range_m FLOAT NOT NULL,
	region TEXT,
	spec JSON NOT NULL,
	PRIMARY KEY (run_id, kind, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE sensor_cover (
	run_id INTEGER NOT NULL,
	number INTEGER NOT NULL,
	cycle INTEGER NOT NULL,
	latitude_deg FLOAT,
	longitude_deg FLOAT,
	range_m FLOAT NOT NULL,
	turns FLOAT NOT NULL,
	ais_detection BLOB NOT NULL,
	ais_looks BLOB NOT NULL,
	track_detection BLOB NOT NULL,
	track_looks BLOB NOT NULL,
	false_plots_per_km2 BLOB NOT NULL,
	PRIMARY KEY (run_id, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE TABLE sensor_registration (
	run_id INTEGER NOT NULL,
	cycle INTEGER NOT NULL,
	kind VARCHAR(16) NOT NULL,
	number INTEGER NOT NULL,
	heard_s FLOAT,
	state VARCHAR(16),
	azimuth_bias_deg FLOAT,
	azimuth_sigma_deg FLOAT,
	range_bias_m FLOAT,
	range_sigma_m FLOAT,
	time_lag_s FLOAT,
	estimated_lag_s FLOAT,
	lag_sigma_s FLOAT,
	vessels INTEGER,
	residuals FLOAT,
	time_jitter_s FLOAT,
	compared INTEGER,
	candidate_azimuth_deg FLOAT,
	candidate_range_m FLOAT,
	odds FLOAT,
	found_odds FLOAT,
	voices INTEGER,
	rival_share FLOAT,
	states INTEGER,
	dropped INTEGER,
	tracks INTEGER,
	position_sigma_m FLOAT,
	velocity_sigma_m_s FLOAT,
	range_scale FLOAT,
	range_scale_sigma FLOAT,
	site_east_m FLOAT,
	site_north_m FLOAT,
	site_sigma_m FLOAT,
	range_noise_factor FLOAT,
	azimuth_noise_factor FLOAT,
	turn_s FLOAT,
	spokes_a_turn INTEGER,
	spokes_lost INTEGER,
	parts_lost INTEGER,
	lost_share FLOAT,
	plots_a_turn FLOAT,
	threshold_db FLOAT,
	detection_probability FLOAT,
	false_plots_a_turn FLOAT,
	PRIMARY KEY (run_id, cycle, kind, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE TABLE source (
	run_id INTEGER NOT NULL,
	number INTEGER NOT NULL,
	name TEXT NOT NULL,
	kind VARCHAR(16) NOT NULL,
	PRIMARY KEY (run_id, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE spot (
	run_id INTEGER NOT NULL,
	cycle INTEGER NOT NULL,
	spot INTEGER NOT NULL,
	latitude_deg FLOAT NOT NULL,
	longitude_deg FLOAT NOT NULL,
	members INTEGER NOT NULL,
	halo INTEGER NOT NULL,
	PRIMARY KEY (run_id, cycle, spot),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE TABLE stage_timing (
	run_id INTEGER NOT NULL,
	cycle INTEGER NOT NULL,
	number INTEGER NOT NULL,
	stage TEXT NOT NULL,
	seconds FLOAT NOT NULL,
	rows INTEGER,
	PRIMARY KEY (run_id, cycle, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE TABLE standing_echo (
	run_id INTEGER NOT NULL,
	number INTEGER NOT NULL,
	radar INTEGER NOT NULL,
	cycle INTEGER NOT NULL,
	latitude_deg FLOAT NOT NULL,
	longitude_deg FLOAT NOT NULL,
	extent_m FLOAT NOT NULL,
	plots_per_turn FLOAT NOT NULL,
	turns FLOAT NOT NULL,
	PRIMARY KEY (run_id, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;

CREATE TABLE track_journal (
	run_id INTEGER NOT NULL,
	cycle INTEGER NOT NULL,
	time_s FLOAT NOT NULL,
	message BLOB NOT NULL,
	PRIMARY KEY (run_id, cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE track_source (
	run_id INTEGER NOT NULL,
	number INTEGER NOT NULL,
	name TEXT NOT NULL,
	latitude_deg FLOAT,
	longitude_deg FLOAT,
	PRIMARY KEY (run_id, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE vessel_static (
	run_id INTEGER NOT NULL,
	mmsi INTEGER NOT NULL,
	name VARCHAR(20),
	call_sign VARCHAR(7),
	ship_type INTEGER,
	length_m FLOAT,
	beam_m FLOAT,
	updated_s FLOAT NOT NULL,
	PRIMARY KEY (run_id, mmsi),
	FOREIGN KEY(run_id) REFERENCES run (id)
)
 WITHOUT ROWID;
