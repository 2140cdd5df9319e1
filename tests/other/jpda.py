"""A centralised tracker beside the team's: Stone Soup's JPDA, given every robot's unnamed sightings and the true poses of the robots."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDAwithEHM2
from stonesoup.deleter.error import CovarianceBasedDeleter
from stonesoup.functions import gm_reduce_single
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.initiator.simple import MultiMeasurementInitiator
from stonesoup.measures import Mahalanobis
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.array import StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.types.update import GaussianStateUpdate
from stonesoup.updater.kalman import KalmanUpdater

from blackboard.config.world import WorldVisionSection
from blackboard.opinion.classes import is_class
from blackboard.opinion.gaussian.vehicle import wrap
from blackboard.wire.messages import Readings, Truth
from sim_world.sensors import FAR, NEAR, vision_sigma

EPOCH = datetime(2026, 1, 1)
FIRST_SEEN = 3  # sightings that make a track
MISSES = 5  # frames in a row that should show a track and do not, after which it is over
WIDEST = 8.0  # unit^2, of the variances of a place together: a wider track is over


@dataclass
class Central:
    """Mutable; `hear` once per tick. Everything that a real team has to find out is given to it: poses, noise, detection, clutter."""

    vision: WorldVisionSection
    detects: float
    clutter: float  # sightings of nothing in a frame
    speed: float  # unit / s
    _tracks: set[Any] = field(default_factory=set)
    _missed: dict[Any, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # a velocity of this speed that is forgotten in a walk across the map: 2 v^2 / (2 T) for each axis
        motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(self.speed**2 / 10.0)] * 2)
        self._predictor = KalmanPredictor(motion)
        self._updater = KalmanUpdater(None)
        area = self.vision.half_angle * (FAR**2 - NEAR**2)
        hypothesiser = PDAHypothesiser(
            self._predictor, self._updater, clutter_spatial_density=max(1e-6, self.clutter / area),
            prob_detect=self.detects, prob_gate=0.999,
        )  # fmt: skip
        self._associator = JPDAwithEHM2(hypothesiser)
        self._deleter = CovarianceBasedDeleter(WIDEST, mapping=[0, 2])
        near = DistanceHypothesiser(self._predictor, self._updater, Mahalanobis(), missed_distance=3)
        self._initiator = MultiMeasurementInitiator(
            GaussianState([0, 0, 0, 0], np.diag([1, self.speed**2, 1, self.speed**2])),
            deleter=CovarianceBasedDeleter(WIDEST, mapping=[0, 2]),
            data_associator=GNNWith2DAssignment(near),
            updater=self._updater,
            measurement_model=LinearGaussian(4, (0, 2), np.eye(2)),
            min_points=FIRST_SEEN,
        )

    def hear(self, truth: Truth, readings: list[Readings]) -> None:
        """Take the frames of a tick, one after the other."""
        now = EPOCH + timedelta(seconds=truth.time)
        for reading in readings:
            self._frame(now, truth, reading)
        for track in self._tracks:
            if track.timestamp < now:
                track.append(self._predictor.predict(track, timestamp=now))
        over = self._deleter.delete_tracks(self._tracks) | {t for t in self._tracks if self._missed[t] >= MISSES}
        self._tracks -= over

    def places(self) -> Mapping[str, tuple[float, float]]:
        """Where each track is."""
        return {track.id: (float(track.state_vector[0]), float(track.state_vector[2])) for track in self._tracks}

    def _frame(self, now: datetime, truth: Truth, readings: Readings) -> None:
        (x, y), heading = truth.positions[f"robot/{readings.robot}"], truth.headings[f"robot/{readings.robot}"]
        detections = set()
        for sighting in readings.sightings:
            sigma = vision_sigma(sighting.range, self.vision.scale, self.vision.floor)
            if is_class(sighting.subject):
                angle = heading + sighting.bearing
                place = [x + sighting.range * math.cos(angle), y + sighting.range * math.sin(angle)]
                noise = np.eye(2) * (sigma or 13.0 * self.vision.scale) ** 2
                detections.add(Detection(place, timestamp=now, measurement_model=LinearGaussian(4, (0, 2), noise)))
        shown = {t for t in self._tracks if self._is_shown(t, (x, y, heading), now)}
        used = set()
        for track, hypotheses in self._associator.associate(shown, detections, now).items():
            used |= {
                hypothesis.measurement
                for hypothesis in hypotheses
                if hypothesis and float(hypothesis.probability) > 0.05
            }
            missed = max(float(hypothesis.probability) for hypothesis in hypotheses if not hypothesis)
            self._missed[track] = self._missed[track] + 1 if missed > 0.5 else 0
            self._update(track, hypotheses)
        new = self._initiator.initiate(detections - used, now)
        self._missed |= dict.fromkeys(new, 0)
        self._tracks |= new

    def _is_shown(self, track: Track, pose: tuple[float, float, float], now: datetime) -> bool:
        place = self._predictor.predict(track, timestamp=now).state_vector
        dx, dy = float(place[0]) - pose[0], float(place[2]) - pose[1]
        return NEAR < math.hypot(dx, dy) < FAR and abs(wrap(math.atan2(dy, dx) - pose[2])) < self.vision.half_angle

    def _update(self, track: Track, hypotheses: Any) -> None:
        after = [self._updater.update(hypothesis) if hypothesis else hypothesis.prediction for hypothesis in hypotheses]
        mean, covariance = gm_reduce_single(
            StateVectors([state.state_vector for state in after]),
            np.stack([state.covar for state in after], axis=2),
            np.array([float(hypothesis.probability) for hypothesis in hypotheses]),
        )
        track.append(GaussianStateUpdate(mean, covariance, hypotheses, hypotheses[0].measurement.timestamp))
