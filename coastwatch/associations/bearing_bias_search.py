"""The search for a large bias of a sensor of bearings: which turn of all its tracks puts most of them on vessels.

A pair needs a bias near the true one before it is found, and a median needs pairs. So a compass that is wrong by more than some
standard deviations would never be calibrated by its pairs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coastwatch.associations.bearing_sensors import AudiblePairs, SensorBias
from coastwatch.batches import BearingTracks, Floats, Ints, Picture, Sensors, Struct, column
from coastwatch.geodesy import to_plane, wrap_rad

CELLS = 1440  # of a turn
CELL_RAD = 2.0 * np.pi / CELLS
FARTHEST = 80  # cells, 20 degrees: the largest bias that is searched for
EVERY_S, INDEPENDENT_S, FORGET_S = 15.0, 30.0, 600.0
"""Between two looks; time after which bearings and directions tell something new; time in which evidence is forgotten."""

KNOWN_SHARE = 0.7  # of the tracks, that are of vessels in the picture
DIRECTION_SIGMA_RAD = np.radians(0.3)  # of the direction of a vessel
GAIN, RUNNER_UP = 20.0, 8.0
"""Logarithms of likelihood ratios: of a bias against the one that is used, and against any other one that is APART."""

OUTLIER_SIGMAS = 4.5
"""By which a bias stands out of those that are APART: among many vessels some turn always fits better than the others."""

APART_RAD, FAR_RAD, FAR_SIGMAS = np.radians(2.0), np.radians(1.0), 2.0
FEWEST, MATCHED = 5, 0.5  # tracks of a sensor that are on vessels, and their share


@dataclass(frozen=True, eq=False)
class BiasSearch(Struct):
    """What the looks so far say of each bias of each of K sensors."""

    log_likelihood: Floats = column(np.float64, "K", 2 * FARTHEST + 1)  # of biases from -FARTHEST to FARTHEST cells
    looked_s: float = -np.inf

    def updated(
        self,
        bias: SensorBias,
        tracks: BearingTracks,
        picture: Picture,
        audible: AudiblePairs,
        sensors: Sensors,
        time_s: float,
        sigma_rad: float,
    ) -> tuple[BiasSearch, SensorBias]:
        """The search after a look, and the bias of each sensor: another one where the evidence for it is strong.

        A bearing is of a vessel in the picture with probability KNOWN_SHARE, of any of them alike, or anywhere in the arc.
        Args: sigma_rad: standard deviation of a bias that was found so.
        """
        passed_s = time_s - self.looked_s
        if passed_s < EVERY_S:
            return self, bias
        scores = self.log_likelihood * np.exp(-min(passed_s, FORGET_S) / FORGET_S)
        mean, sigma = bias.mean_rad.copy(), bias.sigma_rad.copy()
        sensor = tracks.source - sensors.sonar_source(0)
        for k in np.unique(sensor):
            own = np.flatnonzero(sensor == k)
            own = own[np.argsort(tracks.track_id[own], kind="stable")]
            vessels = audible.vessel_row[(audible.sensor == k) & audible.inside]
            if min(len(own), len(vessels)) < FEWEST:
                continue
            site_deg = tracks.site_deg[own[np.argmax(tracks.updated_s[own])]]
            direction = np.arctan2(*to_plane(picture.position_deg[vessels], np.tile(site_deg, (len(vessels), 1))).T)
            spread_rad = np.hypot(np.sqrt(np.median(tracks.covariance[own, 0, 0])), DIRECTION_SIGMA_RAD)
            density = _density(direction, float(spread_rad))
            cell = _cells(tracks.bearing_rad[own])
            known = KNOWN_SHARE * density[(cell[:, None] - np.arange(-FARTHEST, FARTHEST + 1)) % CELLS]
            anywhere = (1.0 - KNOWN_SHARE) / sensors.sonars.arc_width_rad[k]
            scores[k] += min(passed_s / INDEPENDENT_S, 1.0) * np.log(known + anywhere).sum(axis=0)
            best, used = int(scores[k].argmax()), int(np.clip(round(mean[k] / CELL_RAD), -FARTHEST, FARTHEST)) + FARTHEST
            found_rad = (best - FARTHEST) * CELL_RAD
            apart = np.abs(np.arange(2 * FARTHEST + 1) - best) * CELL_RAD > APART_RAD
            matched = np.count_nonzero(known[:, best] > anywhere)
            others = scores[k, apart]
            stands_out = scores[k, best] - others.mean() > OUTLIER_SIGMAS * others.std()
            is_better = scores[k, best] - scores[k, used] > GAIN and scores[k, best] - others.max() > RUNNER_UP and stands_out
            is_far = abs(float(wrap_rad(np.array(found_rad - mean[k])))) > max(FAR_RAD, FAR_SIGMAS * sigma[k])
            if is_better and is_far and matched >= max(FEWEST, MATCHED * len(own)):
                mean[k], sigma[k] = found_rad, sigma_rad
        return BiasSearch(scores, time_s), replace(bias, mean_rad=mean, sigma_rad=sigma)


def _density(direction_rad: Floats, spread_rad: float) -> Floats:
    """Density of these directions in each cell of a turn, each of them a bell of this width. (CELLS,)"""
    count = np.bincount(_cells(direction_rad), minlength=CELLS) / len(direction_rad)
    turns = np.fft.rfftfreq(CELLS, 1.0 / CELLS)
    smooth = np.fft.irfft(np.fft.rfft(count) * np.exp(-0.5 * (turns * spread_rad) ** 2), CELLS)
    return np.maximum(smooth, 0.0) / CELL_RAD


def _cells(angle_rad: Floats) -> Ints:
    """The cell of each angle."""
    return np.floor(angle_rad / CELL_RAD + 0.5).astype(np.int64) % CELLS
