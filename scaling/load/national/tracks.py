"""Radar and AIS tracks of a national picture, as regions and AIS receivers send them to the centre.

Each slot of the traffic has up to three channels: radar tracks in an even and in an odd region, and an AIS track.
Neighbouring regions have different parity, so a vessel in an overlap has a radar track in both. Channels are drawn once by
`draw_channels`; `next_tracks` gives the tracks of a cycle. Each track has the time of its own newest report. Its errors are
correlated in time and as large as its covariance says.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from coastwatch.batches import ID_STRIDE, Array, Batch, Bools, Floats, Ints, Struct, Tracks, column
from coastwatch.geodesy import difference_m, scale_m_deg, wrap_deg
from scaling.load.national.coasts import (
    MAX_COAST_M,
    REGION_LENGTH_M,
    REGION_OVERLAP,
    Coasts,
    covering_regions,
    nearest_radar,
    radar_sites,
    to_geodetic,
)
from scaling.load.national.traffic import (
    ABSENT_S,
    FAR_OFFSHORE_M,
    MEAN_LIVES_PER_S,
    VESSELS_PER_METRE,
    Slots,
    Traffic,
    TrueMotion,
    true_motion,
)

BOTH_SHARE = 0.514  # of the slots have radar and AIS; because tracks break, half of the vessels have both at a time
TRACKED_SHARE = 0.986  # of the time that a vessel is present, its channel has a track
MASKED_SHARE = 0.6  # of the berths stand between buildings, where no radar sees them
AIS_SPEED_STEPS_M_S = 14.0 * 1852.0 / 3600.0, 23.0 * 1852.0 / 3600.0  # where the interval of AIS class A steps down
AIS_INTERVAL_S = 10.0, 6.0, 2.0
RADAR_INTERVAL_S = (2.0, 4.0)
RADAR_BREAK_S, RADAR_GAP_S = (600.0, 1800.0), 20.0  # from the end of one track to the end of the next; gap between the two
AIS_BREAK_S, AIS_GAP_S = (1800.0, 5400.0), 40.0
MMSI_CHANGE_SHARE, MMSI_CHANGE_S = 0.03, 900.0  # share of AIS channels whose vessels change their MMSI, and how often
NO_COVARIANCE_SHARE = 0.2  # of AIS channels
AIS_SIGMA_M = (5.0, 10.0)  # of positions, per axis
CORRELATION_S = (10.0, 20.0)  # time constant of the errors of a track
FIRST_MMSI, MMSIS = 201_000_000, 570_000_000
BLOCK_ROWS = 1 << 16  # rows per block, so that intermediate arrays stay in the processor's cache
RANGE_SIGMA_M, AZIMUTH_SIGMA_RAD = 15.0, np.radians(0.1)  # of one radar report
SMOOTHING = 0.4  # standard deviation of a track over that of one report, across the beam
RADAR_SIGMA_M = (10.0, 25.0)  # of a radar track: along the beam the first, across the beam within both
VELOCITY_SIGMA_PER_S = 0.03  # standard deviation of a velocity over that of the position
POSITION_VELOCITY_CORRELATION = 0.5


class ChannelKind(IntEnum):
    """Which sensor sees the slot."""

    EVEN_REGION = 0
    ODD_REGION = 1
    AIS = 2


@dataclass(frozen=True, eq=False)
class Channels(Batch):
    """One row per possible track, R in all: radar before AIS, otherwise in random order."""

    slot: Array = column(np.int32, "R")
    kind: Array = column(np.int8, "R")  # ChannelKind
    interval_s: Floats = column(np.float64, "R")  # between reports
    phase: Array = column(np.float32, "R")  # 0 to 1, of the reports
    sigma_m: Array = column(np.float32, "R")  # of AIS positions, per axis
    correlation_s: Array = column(np.float32, "R")
    break_s: Array = column(np.float32, "R")  # from one track to the next
    mmsi_change_s: Array = column(np.float32, "R")  # from one MMSI to the next, inf for never
    has_covariance: Bools = column(np.bool_, "R")


@dataclass(frozen=True, eq=False)
class ChannelState(Struct):
    """What the next cycle needs of the last one, one row per channel."""

    error: Array = column(np.float32, "R", 4)  # in standard deviations
    track_id: Ints = column(np.int64, "R")  # -1: there was no track
    started_s: Floats = column(np.float64, "R")  # first report, since the start
    updated_s: Floats = column(np.float64, "R")  # newest report, since the start

    @staticmethod
    def initial(count: int) -> ChannelState:
        """The state before the first cycle: no tracks."""
        never = np.full(count, -np.inf)
        return ChannelState(np.zeros((count, 4), np.float32), np.full(count, -1, np.int64), never, never)


def slots_for(tracks: int) -> int:
    """The number of slots that has this number of tracks on average.

    Half of the V vessels have radar and AIS. A share r has radar alone and a share a has AIS alone: r + a = 1/2.
    Let o be the share of radar vessels that are in two regions. Then either kind has (1/2 + r)(1 + o) V = (1/2 + a) V tracks.
    So V = 0.64 N at o = 0.1, and 2 N / 3 without overlap. The last line corrects for absent vessels and broken tracks.
    """
    regions = max(2, round(0.64 * tracks / VESSELS_PER_METRE / REGION_LENGTH_M))
    overlap = REGION_OVERLAP * (1.0 - 1.0 / min(regions, MAX_COAST_M / REGION_LENGTH_M))
    ais_alone = (1.0 + overlap - BOTH_SHARE) / (2.0 + overlap)
    present = 1.0 - ABSENT_S * MEAN_LIVES_PER_S
    return max(20, round(tracks / (2.0 * (BOTH_SHARE + ais_alone) * present * TRACKED_SHARE)))


def draw_channels(slots: Slots, coasts: Coasts, seed: int) -> Channels:
    """The channels of these slots: half of the slots have both radar and AIS; there are as many radar as AIS tracks."""
    rng = np.random.Generator(np.random.SFC64([seed, 1 << 20]))
    radar, ais = _draw_cover(slots, coasts, rng)
    travels = (slots.kind == Traffic.LANE) | (slots.kind == Traffic.OFFSHORE)
    covered = [radar & (travels | (region >= 0)) for region in covering_regions(coasts, slots.coast, slots.along_m)]
    kinds = zip(ChannelKind, (*covered, ais), strict=True)
    return Channels.join([_draw_kind(rng, slots, rng.permutation(np.flatnonzero(wanted)), kind) for kind, wanted in kinds])


def _draw_cover(slots: Slots, coasts: Coasts, rng: np.random.Generator) -> tuple[Bools, Bools]:
    """Which slots radars see and which have AIS; every slot has at least one of them."""
    count = len(slots)
    masked = (slots.kind == Traffic.BERTH) & (rng.uniform(0.0, 1.0, count) < MASKED_SHARE)
    masked |= (slots.kind == Traffic.OFFSHORE) & (slots.offshore_m >= FAR_OFFSHORE_M[0])
    even, odd = covering_regions(coasts, slots.coast, slots.along_m)
    visible = rng.permutation(np.flatnonzero(~masked))
    both = round(BOTH_SHARE * count)
    twice = float(((even >= 0) & (odd >= 0))[visible].mean())
    radar_alone = round(
        (count * (1.0 - BOTH_SHARE * twice) - both) / (2.0 + twice)
    )  # makes radar and AIS tracks equal in number
    radar, ais = np.zeros(count, bool), np.ones(count, bool)
    radar[visible[: both + radar_alone]] = True
    ais[visible[both : both + radar_alone]] = False
    return radar, ais


def _draw_kind(rng: np.random.Generator, slots: Slots, slot: Ints, kind: int) -> Channels:
    """One channel of this kind for each of these slots."""
    count, is_ais = len(slot), kind == ChannelKind.AIS
    speed = np.abs(slots.speed_m_s[slot])
    interval = np.array(AIS_INTERVAL_S)[np.searchsorted(AIS_SPEED_STEPS_M_S, speed, side="right")]
    if not is_ais:
        interval = rng.uniform(*RADAR_INTERVAL_S, count)
    changes_mmsi = is_ais & (rng.uniform(0.0, 1.0, count) < MMSI_CHANGE_SHARE)
    single = np.float32
    return Channels(
        slot=slot.astype(np.int32),
        kind=np.full(count, kind, np.int8),
        interval_s=interval,
        phase=rng.uniform(0.0, 1.0, count).astype(single),
        sigma_m=rng.uniform(*AIS_SIGMA_M, count).astype(single),
        correlation_s=rng.uniform(*CORRELATION_S, count).astype(single),
        break_s=rng.uniform(*(AIS_BREAK_S if is_ais else RADAR_BREAK_S), count).astype(single),
        mmsi_change_s=np.where(changes_mmsi, MMSI_CHANGE_S, np.inf).astype(single),
        has_covariance=~(is_ais & (rng.uniform(0.0, 1.0, count) < NO_COVARIANCE_SHARE)),
    )


def next_tracks(
    slots: Slots,
    channels: Channels,
    coasts: Coasts,
    state: ChannelState,
    elapsed_s: float,
    start_s: float,
    rng: np.random.Generator,
) -> tuple[ChannelState, Tracks]:
    """The state after a cycle and its tracks, radar before AIS.

    Args: elapsed_s: time of the cycle since the start; start_s: of the picture, since the Unix epoch.
    """
    count, sites = len(channels), radar_sites(coasts)
    empty = np.empty_like
    after = ChannelState(empty(state.error), empty(state.track_id), empty(state.started_s), empty(state.updated_s))
    out = _allocate(count)
    done = 0
    for low in range(0, count, BLOCK_ROWS):
        block = slice(low, min(low + BLOCK_ROWS, count))
        channel = channels.take(np.arange(block.start, block.stop))
        rest = {name: values[done:] for name, values in out.items()}
        done += _write_block(slots, channel, coasts, sites, state, after, block=block, elapsed_s=elapsed_s, rng=rng, out=rest)
    rows = slice(0, done)
    out["updated_s"][rows] += start_s
    out["started_s"][rows] += start_s
    out["time_s"][rows] = out["updated_s"][rows]
    return after, Tracks(**{name: values[rows] for name, values in out.items()})


def _allocate(count: int) -> dict[str, Array]:
    """Empty columns for this number of tracks; pages that are never written take no memory."""
    shapes = {"position_deg": (2,), "velocity_m_s": (2,), "covariance": (4, 4), "report_covariance": (2, 2)}
    numbers, times = ("track_id", "source", "mmsi", "origin"), ("time_s", "updated_s", "started_s")
    out: dict[str, Array] = {name: np.empty(count, np.int64) for name in numbers}
    out |= {name: np.empty(count) for name in times}
    return out | {name: np.empty((count, *shape)) for name, shape in shapes.items()}


def _write_block(
    slots: Slots,
    channels: Channels,
    coasts: Coasts,
    sites: Floats,
    before: ChannelState,
    after: ChannelState,
    *,
    block: slice,
    elapsed_s: float,
    rng: np.random.Generator,
    out: dict[str, Array],
) -> int:
    """The number of tracks of some channels, whose rows in the states are `block`. Writes `after` and the first rows of `out`."""
    time_s = (np.floor(elapsed_s / channels.interval_s + channels.phase) - channels.phase) * channels.interval_s
    true = true_motion(slots, coasts, channels.slot, time_s)
    source, number, mmsi = _identities(slots, channels, coasts, true, time_s)
    track_id = np.where(source >= 0, source * ID_STRIDE + number, -1)
    is_new = track_id != before.track_id[block]
    after.track_id[block], after.updated_s[block] = track_id, np.where(source >= 0, time_s, -np.inf)
    after.started_s[block] = np.where(is_new, time_s, before.started_s[block])
    keep = np.where(is_new, 0.0, np.exp((before.updated_s[block] - time_s) / channels.correlation_s))[:, None]
    normal = rng.standard_normal((len(channels), 4), np.float32)
    after.error[block] = keep * before.error[block] + np.sqrt(1.0 - keep * keep) * normal
    rows = np.flatnonzero(source >= 0)
    shore = (a[rows] for a in (true.along_m, true.offshore_m, true.along_m_s, true.offshore_m_s))
    position, velocity = to_geodetic(coasts, slots.coast[channels.slot[rows]], *shore)
    region = np.where(channels.kind[rows] == ChannelKind.AIS, 0, source[rows])
    site = sites[nearest_radar(coasts, region, true.along_m[rows])]
    covariance = out["covariance"][: len(rows)]
    error, report_covariance = _errors(channels, rows, difference_m(position, site), after.error[block][rows], covariance)
    north, east = scale_m_deg(position[:, 0])
    longitude = wrap_deg(position[:, 1] + error[:, 0] / east)
    columns = {
        "track_id": track_id[rows],
        "source": source[rows],
        "position_deg": np.stack([position[:, 0] + error[:, 1] / north, longitude], axis=-1),
        "velocity_m_s": velocity + error[:, 2:],
        "report_covariance": report_covariance,
        "updated_s": time_s[rows],
        "started_s": after.started_s[block][rows],
        "mmsi": mmsi[rows],
        "origin": (true.generation * len(slots) + channels.slot)[rows],
    }
    for key, values in columns.items():
        out[key][: len(rows)] = values
    return len(rows)


def _identities(slots: Slots, channels: Channels, coasts: Coasts, true: TrueMotion, time_s: Floats) -> tuple[Ints, Ints, Ints]:
    """The source of each channel's track, -1 for no track; its number, unique within the source; its MMSI or -1."""
    is_ais, count = channels.kind == ChannelKind.AIS, len(channels)
    regions = np.stack(covering_regions(coasts, slots.coast[channels.slot], true.region_along_m))
    ais_source = len(coasts.latitude_deg) * coasts.regions
    source = np.where(is_ais, ais_source, regions[np.minimum(channels.kind, ChannelKind.ODD_REGION), np.arange(count)])
    breaks = time_s / channels.break_s + channels.phase
    broken = np.floor(breaks)
    silent: Bools = (breaks - broken) * channels.break_s < np.where(is_ais, AIS_GAP_S, RADAR_GAP_S)
    identity = true.generation + np.floor(time_s / channels.mmsi_change_s + channels.phase).astype(np.int64)
    number = len(slots) * (np.where(is_ais, identity, true.generation) + broken.astype(np.int64)) + channels.slot
    mmsi = np.where(is_ais, FIRST_MMSI + (len(slots) * identity + channels.slot) % MMSIS, -1)
    return np.where(true.present & ~silent, source, -1), number, mmsi


def _errors(channels: Channels, rows: Ints, from_site_m: Floats, error: Array, covariance: Floats) -> tuple[Floats, Floats]:
    """Errors (R, 4) of the tracks of these rows, and covariances (R, 2, 2) of one report.

    Args:
        from_site_m: (R, 2) from the radar.
        error: (R, 4) in standard deviations: along and across the beam, of the position and of the independent part of the velocity.
        covariance: (R, 4, 4) of the tracks, written; NaN where the channel has none.
    """
    is_ais, distance = channels.kind[rows] == ChannelKind.AIS, np.hypot(from_site_m[:, 0], from_site_m[:, 1])
    beam = from_site_m / distance[:, None]
    report = AZIMUTH_SIGMA_RAD * distance
    along = np.where(is_ais, channels.sigma_m[rows], RADAR_SIGMA_M[0])
    across = np.where(is_ais, channels.sigma_m[rows], np.clip(SMOOTHING * report, *RADAR_SIGMA_M))
    position = _east_north(beam, along * error[:, 0], across * error[:, 1])
    independent = _east_north(beam, along * error[:, 2], across * error[:, 3])
    rho = POSITION_VELOCITY_CORRELATION
    velocity = VELOCITY_SIGMA_PER_S * (rho * position + np.sqrt(1.0 - rho**2) * independent)
    block = _beam_covariance(beam, along, across)
    covariance[:, :2, :2] = block
    covariance[:, 2:, 2:] = VELOCITY_SIGMA_PER_S**2 * block
    covariance[:, :2, 2:] = covariance[:, 2:, :2] = rho * VELOCITY_SIGMA_PER_S * block
    covariance[~channels.has_covariance[rows]] = np.nan
    report_covariance = _beam_covariance(beam, np.where(is_ais, along, RANGE_SIGMA_M), np.where(is_ais, across, report))
    return np.concatenate([position, velocity], axis=1), report_covariance


def _east_north(beam: Floats, along: Floats, across: Floats) -> Floats:
    """East and north components (R, 2) of a vector given along and across the beam. Args: beam: (R, 2) unit vectors."""
    return np.stack([beam[:, 0] * along - beam[:, 1] * across, beam[:, 1] * along + beam[:, 0] * across], axis=-1)


def _beam_covariance(beam: Floats, along: Floats, across: Floats) -> Floats:
    """Covariance east and north (R, 2, 2) of standard deviations along and across the beam."""
    a, b = along**2, across**2
    both = (a - b) * beam[:, 0] * beam[:, 1]
    east, north = a * beam[:, 0] ** 2 + b * beam[:, 1] ** 2, a * beam[:, 1] ** 2 + b * beam[:, 0] ** 2
    return np.stack([east, both, both, north], axis=-1).reshape(-1, 2, 2)
