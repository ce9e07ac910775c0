-- Generated from coastwatch/store/schema/tables.py, schema 0028, by `make docs`.

CREATE TABLE audit (
	id BIGSERIAL NOT NULL,
	time_s FLOAT(53) NOT NULL,
	who TEXT NOT NULL,
	role VARCHAR(16) NOT NULL,
	client TEXT NOT NULL,
	method VARCHAR(16) NOT NULL,
	path TEXT NOT NULL,
	http_status BIGINT NOT NULL,
	body TEXT NOT NULL,
	PRIMARY KEY (id)
);

CREATE TABLE run (
	id BIGSERIAL NOT NULL,
	scenario TEXT NOT NULL,
	title TEXT NOT NULL,
	seed BIGINT NOT NULL,
	version VARCHAR(32) NOT NULL,
	settings JSON NOT NULL,
	command TEXT NOT NULL,
	started_utc VARCHAR(32) NOT NULL,
	finished_utc VARCHAR(32),
	written_utc VARCHAR(32),
	machine TEXT,
	process BIGINT,
	status VARCHAR(16) NOT NULL,
	period_s FLOAT(53) NOT NULL,
	cycles BIGINT NOT NULL,
	warmup_cycles BIGINT NOT NULL,
	start_s FLOAT(53) NOT NULL,
	workers BIGINT NOT NULL,
	scores JSON,
	verdict JSON,
	faults JSON NOT NULL,
	PRIMARY KEY (id)
);

CREATE TABLE vessel (
	run_id BIGINT NOT NULL,
	vessel_id BIGINT NOT NULL,
	time_s FLOAT(53) NOT NULL,
	latitude_deg FLOAT(53) NOT NULL,
	longitude_deg FLOAT(53) NOT NULL,
	sog_kn FLOAT(53),
	cog_deg FLOAT(53),
	major_m FLOAT(53),
	minor_m FLOAT(53),
	orientation_deg FLOAT(53),
	since_s FLOAT(53) NOT NULL,
	updated_s FLOAT(53) NOT NULL,
	mmsi BIGINT,
	flags BIGINT NOT NULL,
	sources TEXT NOT NULL,
	covariance BYTEA,
	nav_status BIGINT,
	interval_s FLOAT(53),
	existence FLOAT(53),
	echo_length_m FLOAT(53),
	echo_width_m FLOAT(53),
	echo_axis_deg FLOAT(53),
	alternative_m FLOAT(53),
	PRIMARY KEY (run_id, vessel_id)
);

CREATE TABLE zone (
	number BIGINT NOT NULL,
	version BIGINT NOT NULL,
	scenario TEXT NOT NULL,
	definition JSON,
	changed_s FLOAT(53) NOT NULL,
	changed_by TEXT NOT NULL,
	PRIMARY KEY (number, version)
);

CREATE INDEX zone_scenario ON zone (scenario, number, version);

CREATE TABLE acknowledgement (
	run_id BIGINT NOT NULL,
	vessel_id BIGINT NOT NULL,
	kind VARCHAR(32) NOT NULL,
	subject BIGINT NOT NULL,
	from_cycle BIGINT NOT NULL,
	acknowledged_s FLOAT(53) NOT NULL,
	acknowledged_by TEXT NOT NULL,
	note TEXT NOT NULL,
	who TEXT NOT NULL,
	PRIMARY KEY (run_id, vessel_id, kind, subject, from_cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE INDEX acknowledgement_time ON acknowledgement (run_id, acknowledged_s);

CREATE TABLE ais_feed (
	run_id BIGINT NOT NULL,
	number BIGINT NOT NULL,
	name TEXT NOT NULL,
	PRIMARY KEY (run_id, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE association (
	run_id BIGINT NOT NULL,
	cycle BIGINT NOT NULL,
	vessel_id BIGINT NOT NULL,
	first_source BIGINT NOT NULL,
	first_track BIGINT NOT NULL,
	second_source BIGINT NOT NULL,
	second_track BIGINT NOT NULL,
	statistic FLOAT(53),
	PRIMARY KEY (run_id, cycle, vessel_id, first_source, first_track, second_source, second_track),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE bearing_association (
	run_id BIGINT NOT NULL,
	cycle BIGINT NOT NULL,
	vessel_id BIGINT NOT NULL,
	source BIGINT NOT NULL,
	bearing_track BIGINT NOT NULL,
	statistic FLOAT(53),
	bearing_deg FLOAT(53) NOT NULL,
	PRIMARY KEY (run_id, cycle, vessel_id, source, bearing_track),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE bearing_track (
	run_id BIGINT NOT NULL,
	source BIGINT NOT NULL,
	track_id BIGINT NOT NULL,
	bearing_deg FLOAT(53) NOT NULL,
	rate_deg_s FLOAT(53),
	latitude_deg FLOAT(53) NOT NULL,
	longitude_deg FLOAT(53) NOT NULL,
	vessel_id BIGINT,
	updated_s FLOAT(53) NOT NULL,
	PRIMARY KEY (run_id, source, track_id),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE checkpoint (
	run_id BIGINT NOT NULL,
	piece BIGINT NOT NULL,
	cycle BIGINT NOT NULL,
	memory BYTEA NOT NULL,
	PRIMARY KEY (run_id, piece),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE cycle (
	run_id BIGINT NOT NULL,
	number BIGINT NOT NULL,
	time_s FLOAT(53) NOT NULL,
	vessels BIGINT NOT NULL,
	tracks BIGINT NOT NULL,
	pairs BIGINT NOT NULL,
	bearing_pairs BIGINT NOT NULL,
	reports BIGINT NOT NULL,
	picture_kept BOOLEAN NOT NULL,
	history_from BIGINT,
	history_points BIGINT NOT NULL,
	associations_kept BOOLEAN NOT NULL,
	recorded BOOLEAN DEFAULT false NOT NULL,
	skipped VARCHAR(16),
	PRIMARY KEY (run_id, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE INDEX cycle_time ON cycle (run_id, time_s);

CREATE TABLE decided_path (
	run_id BIGINT NOT NULL,
	cycle BIGINT NOT NULL,
	vessel_id BIGINT NOT NULL,
	number BIGINT NOT NULL,
	time_s FLOAT(53) NOT NULL,
	latitude_deg FLOAT(53) NOT NULL,
	longitude_deg FLOAT(53) NOT NULL,
	sog_kn FLOAT(53),
	cog_deg FLOAT(53),
	major_m FLOAT(53),
	minor_m FLOAT(53),
	orientation_deg FLOAT(53),
	track_id BIGINT NOT NULL,
	radar BIGINT,
	PRIMARY KEY (run_id, cycle, vessel_id, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE event (
	run_id BIGINT NOT NULL,
	vessel_id BIGINT NOT NULL,
	kind VARCHAR(32) NOT NULL,
	subject BIGINT NOT NULL,
	from_cycle BIGINT NOT NULL,
	to_cycle BIGINT,
	start_s FLOAT(53) NOT NULL,
	end_s FLOAT(53),
	latitude_deg FLOAT(53) NOT NULL,
	longitude_deg FLOAT(53) NOT NULL,
	sog_kn FLOAT(53),
	mmsi BIGINT,
	evidence TEXT NOT NULL,
	unacknowledged BOOLEAN DEFAULT false NOT NULL,
	PRIMARY KEY (run_id, vessel_id, kind, subject, from_cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE INDEX event_start ON event (run_id, start_s);

CREATE INDEX event_to ON event (run_id, to_cycle);

CREATE INDEX event_unacknowledged ON event (run_id, start_s) WHERE unacknowledged;

CREATE TABLE event_gap (
	run_id BIGINT NOT NULL,
	vessel_id BIGINT NOT NULL,
	kind VARCHAR(32) NOT NULL,
	subject BIGINT NOT NULL,
	from_cycle BIGINT NOT NULL,
	cycle BIGINT NOT NULL,
	last_cycle BIGINT NOT NULL,
	last_s FLOAT(53) NOT NULL,
	PRIMARY KEY (run_id, vessel_id, kind, subject, from_cycle, cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE INDEX event_gap_cycle ON event_gap (run_id, cycle);

CREATE TABLE history (
	run_id BIGINT NOT NULL,
	cycle BIGINT NOT NULL,
	vessel_id BIGINT NOT NULL,
	latitude_deg FLOAT(53) NOT NULL,
	longitude_deg FLOAT(53) NOT NULL,
	sog_kn FLOAT(53),
	cog_deg FLOAT(53),
	major_m FLOAT(53),
	minor_m FLOAT(53),
	orientation_deg FLOAT(53),
	updated_s FLOAT(53) NOT NULL,
	mmsi BIGINT,
	flags BIGINT NOT NULL,
	previous_cycle BIGINT,
	closing BOOLEAN DEFAULT false NOT NULL,
	nav_status BIGINT,
	PRIMARY KEY (run_id, cycle, vessel_id),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE INDEX history_box ON history (run_id, cycle, latitude_deg, longitude_deg);

CREATE TABLE identity (
	run_id BIGINT NOT NULL,
	mmsi BIGINT NOT NULL,
	vessel_id BIGINT NOT NULL,
	from_cycle BIGINT NOT NULL,
	to_cycle BIGINT,
	PRIMARY KEY (run_id, mmsi, vessel_id, from_cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE INDEX identity_to ON identity (run_id, to_cycle) WHERE to_cycle IS NOT NULL;

CREATE TABLE member (
	run_id BIGINT NOT NULL,
	vessel_id BIGINT NOT NULL,
	source BIGINT NOT NULL,
	track_id BIGINT NOT NULL,
	PRIMARY KEY (run_id, vessel_id, source, track_id),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE member_history (
	run_id BIGINT NOT NULL,
	vessel_id BIGINT NOT NULL,
	source BIGINT NOT NULL,
	track_id BIGINT NOT NULL,
	from_cycle BIGINT NOT NULL,
	to_cycle BIGINT,
	PRIMARY KEY (run_id, vessel_id, source, track_id, from_cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE INDEX member_history_from ON member_history (run_id, from_cycle);

CREATE INDEX member_history_to ON member_history (run_id, to_cycle) WHERE to_cycle IS NOT NULL;

CREATE TABLE presence (
	run_id BIGINT NOT NULL,
	vessel_id BIGINT NOT NULL,
	from_cycle BIGINT NOT NULL,
	to_cycle BIGINT,
	since_s FLOAT(53) NOT NULL,
	PRIMARY KEY (run_id, vessel_id, from_cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE INDEX presence_from ON presence (run_id, from_cycle);

CREATE INDEX presence_to ON presence (run_id, to_cycle) WHERE to_cycle IS NOT NULL;

CREATE TABLE recording (
	run_id BIGINT NOT NULL,
	cycle BIGINT NOT NULL,
	vessels BIGINT NOT NULL,
	members BIGINT NOT NULL,
	vessel_id BYTEA NOT NULL,
	time_s BYTEA NOT NULL,
	position_deg BYTEA NOT NULL,
	velocity_m_s BYTEA NOT NULL,
	covariance BYTEA NOT NULL,
	since_s BYTEA NOT NULL,
	updated_s BYTEA NOT NULL,
	mmsi BYTEA NOT NULL,
	flags BYTEA NOT NULL,
	origin BYTEA NOT NULL,
	member_vessel_id BYTEA NOT NULL,
	member_track_id BYTEA NOT NULL,
	member_source BYTEA NOT NULL,
	nav_status BYTEA,
	existence BYTEA,
	alternative_m BYTEA,
	echo_length_m BYTEA,
	echo_width_m BYTEA,
	echo_axis_deg BYTEA,
	PRIMARY KEY (run_id, cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE region_intake (
	run_id BIGINT NOT NULL,
	cycle BIGINT NOT NULL,
	number BIGINT NOT NULL,
	region TEXT NOT NULL,
	region_run VARCHAR(64) NOT NULL,
	first_seq BIGINT NOT NULL,
	last_seq BIGINT NOT NULL,
	late BIGINT NOT NULL,
	PRIMARY KEY (run_id, cycle, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE sensor (
	run_id BIGINT NOT NULL,
	kind VARCHAR(16) NOT NULL,
	number BIGINT NOT NULL,
	name TEXT NOT NULL,
	latitude_deg FLOAT(53) NOT NULL,
	longitude_deg FLOAT(53) NOT NULL,
	range_m FLOAT(53) NOT NULL,
	region TEXT,
	spec JSON NOT NULL,
	PRIMARY KEY (run_id, kind, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE sensor_cover (
	run_id BIGINT NOT NULL,
	number BIGINT NOT NULL,
	cycle BIGINT NOT NULL,
	latitude_deg FLOAT(53),
	longitude_deg FLOAT(53),
	range_m FLOAT(53) NOT NULL,
	turns FLOAT(53) NOT NULL,
	ais_detection BYTEA NOT NULL,
	ais_looks BYTEA NOT NULL,
	track_detection BYTEA NOT NULL,
	track_looks BYTEA NOT NULL,
	false_plots_per_km2 BYTEA NOT NULL,
	PRIMARY KEY (run_id, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE sensor_registration (
	run_id BIGINT NOT NULL,
	cycle BIGINT NOT NULL,
	kind VARCHAR(16) NOT NULL,
	number BIGINT NOT NULL,
	heard_s FLOAT(53),
	state VARCHAR(16),
	azimuth_bias_deg FLOAT(53),
	azimuth_sigma_deg FLOAT(53),
	range_bias_m FLOAT(53),
	range_sigma_m FLOAT(53),
	time_lag_s FLOAT(53),
	estimated_lag_s FLOAT(53),
	lag_sigma_s FLOAT(53),
	vessels BIGINT,
	residuals FLOAT(53),
	time_jitter_s FLOAT(53),
	compared BIGINT,
	candidate_azimuth_deg FLOAT(53),
	candidate_range_m FLOAT(53),
	odds FLOAT(53),
	found_odds FLOAT(53),
	voices BIGINT,
	rival_share FLOAT(53),
	states BIGINT,
	dropped BIGINT,
	tracks BIGINT,
	position_sigma_m FLOAT(53),
	velocity_sigma_m_s FLOAT(53),
	range_scale FLOAT(53),
	range_scale_sigma FLOAT(53),
	site_east_m FLOAT(53),
	site_north_m FLOAT(53),
	site_sigma_m FLOAT(53),
	range_noise_factor FLOAT(53),
	azimuth_noise_factor FLOAT(53),
	turn_s FLOAT(53),
	spokes_a_turn BIGINT,
	spokes_lost BIGINT,
	parts_lost BIGINT,
	lost_share FLOAT(53),
	plots_a_turn FLOAT(53),
	threshold_db FLOAT(53),
	detection_probability FLOAT(53),
	false_plots_a_turn FLOAT(53),
	PRIMARY KEY (run_id, cycle, kind, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE source (
	run_id BIGINT NOT NULL,
	number BIGINT NOT NULL,
	name TEXT NOT NULL,
	kind VARCHAR(16) NOT NULL,
	PRIMARY KEY (run_id, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE spot (
	run_id BIGINT NOT NULL,
	cycle BIGINT NOT NULL,
	spot BIGINT NOT NULL,
	latitude_deg FLOAT(53) NOT NULL,
	longitude_deg FLOAT(53) NOT NULL,
	members BIGINT NOT NULL,
	halo BIGINT NOT NULL,
	PRIMARY KEY (run_id, cycle, spot),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE stage_timing (
	run_id BIGINT NOT NULL,
	cycle BIGINT NOT NULL,
	number BIGINT NOT NULL,
	stage TEXT NOT NULL,
	seconds FLOAT(53) NOT NULL,
	rows BIGINT,
	PRIMARY KEY (run_id, cycle, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE standing_echo (
	run_id BIGINT NOT NULL,
	number BIGINT NOT NULL,
	radar BIGINT NOT NULL,
	cycle BIGINT NOT NULL,
	latitude_deg FLOAT(53) NOT NULL,
	longitude_deg FLOAT(53) NOT NULL,
	extent_m FLOAT(53) NOT NULL,
	plots_per_turn FLOAT(53) NOT NULL,
	turns FLOAT(53) NOT NULL,
	PRIMARY KEY (run_id, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE track_journal (
	run_id BIGINT NOT NULL,
	cycle BIGINT NOT NULL,
	time_s FLOAT(53) NOT NULL,
	message BYTEA NOT NULL,
	PRIMARY KEY (run_id, cycle),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE track_source (
	run_id BIGINT NOT NULL,
	number BIGINT NOT NULL,
	name TEXT NOT NULL,
	latitude_deg FLOAT(53),
	longitude_deg FLOAT(53),
	PRIMARY KEY (run_id, number),
	FOREIGN KEY(run_id) REFERENCES run (id)
);

CREATE TABLE vessel_static (
	run_id BIGINT NOT NULL,
	mmsi BIGINT NOT NULL,
	name VARCHAR(20),
	call_sign VARCHAR(7),
	ship_type BIGINT,
	length_m FLOAT(53),
	beam_m FLOAT(53),
	updated_s FLOAT(53) NOT NULL,
	PRIMARY KEY (run_id, mmsi),
	FOREIGN KEY(run_id) REFERENCES run (id)
);
