"""The common input of all peers: seeded tracks of moored, steady and turning vessels, half of them seen by radar and AIS."""

from __future__ import annotations

import numpy as np

from coastwatch.associations import WindowedCovariance
from coastwatch.fused_tracks import ImmOfTracks
from coastwatch.geodesy import from_plane
from coastwatch.spots import KMeansSpots
from scaling.peers.exchange import AIS, RADAR, Floats, Ints, TrackHistory

ORIGIN_DEG = np.array([0.0, 3.0])  # on the equator, where east of the plane is east on the ground
PERIOD_S = 3.0
VESSELS_PER_KM2 = 2.0
MOORED, TURNING = 0.3, 0.15  # shares of vessels
ANCHOR_SPACING_M, ANCHOR_OFFSET_M, ANCHORAGE_VESSELS = 250.0, 60.0, 25  # the offset is from the point of the lattice
CORRELATION_S = {RADAR: 15.0, AIS: 30.0}  # of the errors of tracks
AIS_SIGMA = (6.0, 0.5)  # m, m/s
RADAR_SIGMA_M = (8.0, 20.0)  # along and across: least and most
RADAR_SIGMA_M_S = 0.4
PLOT_TO_TRACK = 4.0  # covariance of one plot over the position covariance of its track


def make_history(tracks: int, cycles: int, measured: int, seed: int) -> TrackHistory:
    """N tracks over T cycles: N / 3 vessels have a radar and an AIS track, N / 6 have radar alone, N / 6 AIS alone.

    Args: tracks: N, half radar, half AIS; cycles: T; measured: number of cycles at the end that are timed.
    """
    rng = np.random.default_rng([seed, 0])
    vessels = round(tracks * 2 / 3)
    both = tracks - vessels
    alone = (vessels - both) // 2
    vessel = np.concatenate([np.arange(both + alone), np.arange(both), np.arange(both + alone, vessels)])
    source = np.repeat([RADAR, AIS], [both + alone, tracks - both - alone])
    mixed = rng.permutation(tracks)
    vessel, source = vessel[mixed].astype(np.int64), source[mixed].astype(np.int64)
    time_s = 1.8e9 + PERIOD_S * np.arange(1.0, cycles + 1.0)
    true_position, true_velocity = _motion(rng, vessels, cycles)
    covariance = _covariances(rng, source)
    errors = _errors(rng, covariance, source, cycles)
    position = true_position[:, vessel] + errors[..., :2]
    report = np.where((source == RADAR)[:, None, None], PLOT_TO_TRACK, 1.0) * covariance[:, :2, :2]
    return TrackHistory(
        time_s,
        measured,
        np.arange(1, tracks + 1),
        source,
        vessel,
        position,
        from_plane(position, ORIGIN_DEG),
        true_velocity[:, vessel] + errors[..., 2:],
        covariance,
        report,
        true_position,
        true_velocity,
        settings(),
    )


def settings() -> dict[str, object]:
    """The defaults of Coastwatch that a peer can share."""
    associations, spots, imm = WindowedCovariance(), KMeansSpots(), ImmOfTracks().model_dump(mode="json")
    own = {"window": associations.window, "gate_m": associations.gate_m, "tracks_per_spot": spots.tracks_per_spot}
    return {**own, "period_s": PERIOD_S, "imm": imm}


def _motion(rng: np.random.Generator, vessels: int, cycles: int) -> tuple[Floats, Floats]:
    """Positions and velocities of all vessels at all cycles: (T, V, 2) each."""
    side_m = 1000.0 * np.sqrt(vessels / VESSELS_PER_KM2)
    position = rng.uniform(-side_m / 2, side_m / 2, (vessels, 2))
    kind = rng.permutation(vessels)
    moored, turning = kind < MOORED * vessels, kind >= (1.0 - TURNING) * vessels
    position[moored] = _anchor_positions(rng, int(moored.sum()), side_m)
    speed = np.where(moored, rng.uniform(0.0, 0.2, vessels), rng.uniform(2.0, 10.0, vessels))
    rate = np.where(turning, np.radians(rng.uniform(0.2, 0.6, vessels)) * rng.choice([-1.0, 1.0], vessels), 0.0)
    course = rng.uniform(0.0, 2.0 * np.pi, vessels) + rate * PERIOD_S * np.arange(cycles + 1)[:, None]
    velocity = speed[:, None] * np.stack([np.sin(course), np.cos(course)], axis=-1)
    moved = 0.5 * PERIOD_S * (velocity[1:] + velocity[:-1])
    return position + np.cumsum(moved, axis=0), velocity[1:]


def _anchor_positions(rng: np.random.Generator, vessels: int, side_m: float) -> Floats:
    """Positions at anchor, metres: small lattices, each vessel at random near its point. Returns: (M, 2)."""
    columns = int(np.sqrt(ANCHORAGE_VESSELS))
    number = np.arange(vessels)
    port = rng.uniform(-side_m / 2, side_m / 2, (vessels // ANCHORAGE_VESSELS + 1, 2))
    point = np.stack([number % ANCHORAGE_VESSELS % columns, number % ANCHORAGE_VESSELS // columns], axis=1) * ANCHOR_SPACING_M
    return port[number // ANCHORAGE_VESSELS] + point + rng.uniform(-ANCHOR_OFFSET_M, ANCHOR_OFFSET_M, (vessels, 2))


def _covariances(rng: np.random.Generator, source: Ints) -> Floats:
    """Covariances of tracks: of radar an ellipse in a random direction, of AIS a circle. Returns: (N, 4, 4)."""
    count = len(source)
    out = np.zeros((count, 4, 4))
    out[:, [0, 1], [0, 1]], out[:, [2, 3], [2, 3]] = AIS_SIGMA[0] ** 2, AIS_SIGMA[1] ** 2
    angle, sigma = rng.uniform(0.0, np.pi, count), rng.uniform(*RADAR_SIGMA_M, (count, 2))
    turned = np.stack([np.stack([np.cos(angle), -np.sin(angle)], -1), np.stack([np.sin(angle), np.cos(angle)], -1)], 1)
    radar = source == RADAR
    out[radar, :2, :2] = np.einsum("nij,nj,nkj->nik", turned, sigma**2, turned)[radar]
    out[radar, 2, 2] = out[radar, 3, 3] = RADAR_SIGMA_M_S**2
    return out


def _errors(rng: np.random.Generator, covariance: Floats, source: Ints, cycles: int) -> Floats:
    """Errors drawn from the covariances and correlated in time, as of filtered tracks. Returns: (T, N, 4)."""
    root = np.linalg.cholesky(covariance)
    keep = np.where(source == RADAR, *(np.exp(-PERIOD_S / CORRELATION_S[s]) for s in (RADAR, AIS)))[:, None]
    white = rng.standard_normal((cycles, len(source), 4))
    for k in range(1, cycles):
        white[k] = keep * white[k - 1] + np.sqrt(1.0 - keep**2) * white[k]
    errors: Floats = np.einsum("nij,tnj->tni", root, white)
    return errors
